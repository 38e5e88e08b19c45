//! Library, master and host.

use crate::bench::Bench;
use crate::bus::BusSpec;
use crate::need::Need;
use crate::step::{Group, Step};
use crate::stop::{Stop, check};

pub const GROUP: Group = Group {
    name: "host",
    steps: &[
        Step {
            name: "scan",
            proves: "The library is loaded, and `ecan scan` identifies every gateway of the bus.",
            needs: &[],
            run: scan,
        },
        Step {
            name: "slaves",
            proves: "`ecan scan` and IgH's own tool list the same slaves.",
            needs: &[Need::LastingBus],
            run: slaves,
        },
        Step {
            name: "doctor",
            proves: "`ecan doctor` checks the host and finds the library usable.",
            needs: &[],
            run: doctor,
        },
    ],
};

fn scan(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(bench.arguments.gateways))?;
    let scan = bench.ecan(["--json", "scan"]);
    let slaves = bench.run(scan)?.expect(0)?.json()?;
    let slaves = slaves.as_array().cloned().unwrap_or_default();
    let gateways = slaves.iter().filter(|slave| slave["is_gateway"] == true).count();
    let expected = usize::from(bench.gateway_count());
    check(gateways == expected, || {
        format!("{gateways} gateways found, expected {expected}: {slaves:?}")
    })
}

fn slaves(bench: &mut Bench) -> Result<(), Stop> {
    scan(bench)?;
    let listed = bench.listed_slaves()?.len();
    let expected = usize::from(bench.gateway_count());
    check(listed >= expected, || format!("the tool lists {listed} slaves, expected {expected}"))
}

fn doctor(bench: &mut Bench) -> Result<(), Stop> {
    let doctor = bench.with_ethercat(bench.ecan(["--json", "doctor"]));
    // Findings about the host, such as power saving, are no failure of the SDK.
    bench.run(doctor)?.expect_one_of(&[0, 1])?.json().map(drop)
}
