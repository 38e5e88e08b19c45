//! Distributed clocks in both directions.

use crate::bench::{Bench, Kind};
use crate::bus::BusSpec;
use crate::need::Need;
use crate::step::{Group, Step};
use crate::steps::echo::{EchoRun, run_echo, run_with_file};
use crate::stop::{Stop, check};

pub const GROUP: Group = Group {
    name: "clocks",
    steps: &[
        Step {
            name: "host_leads",
            proves: "The clocks of the slaves follow the host, with Sync0 and without a warning of the master.",
            needs: &[],
            run: |bench| clocks(bench, 1, "host"),
        },
        Step {
            name: "reference_leads",
            proves: "The cycle of the host follows the reference clock.",
            needs: &[],
            run: |bench| clocks(bench, 1, "reference"),
        },
        Step {
            name: "three_gateways_host_leads",
            proves: "Three gateways with Sync0 follow the host.",
            needs: &[Need::Gateways(3)],
            run: |bench| clocks(bench, 3, "host"),
        },
        Step {
            name: "three_gateways_reference_leads",
            proves: "The cycle of the host follows the first of three gateways.",
            needs: &[Need::Gateways(3)],
            run: |bench| clocks(bench, 3, "reference"),
        },
        Step {
            name: "sync0_frames",
            proves: "With Sync0 every frame is delivered and returns.",
            needs: &[Need::EchoNodes],
            run: sync0_frames,
        },
        Step {
            name: "no_warning_without_clocks",
            proves: "A start without distributed clocks causes no warning about a missing application time.",
            needs: &[Need::LastingBus, Need::EchoNodes],
            run: no_warning_without_clocks,
        },
    ],
};

fn clocks(bench: &mut Bench, gateways: u16, source: &str) -> Result<(), Stop> {
    bench.bus(BusSpec::any(gateways))?;
    let slaves = gateways.to_string();
    let cycles = if bench.arguments.quick { "1000" } else { "4000" };
    // Without correction the simulated clocks leave this range within 2 s.
    let settled_us = "100";
    let arguments = ["--slaves", &slaves, "--cycles", cycles, "--source", source];
    let mut program = bench.cyclic_example("dc_clocks", arguments);
    program.args(["--settled-us", settled_us]);
    let finished = bench.run(program)?.expect(0)?;
    let output = finished.output();
    let largest = output
        .lines()
        .find_map(|line| line.strip_prefix("phase error: largest "))
        .and_then(|rest| rest.split_whitespace().next()?.parse().ok());
    let Some(largest) = largest else {
        return Err(Stop::Failed(format!("no phase error: {}", finished.end_text())));
    };
    bench.figure("largest_phase_error_us", largest);
    bench.expect_no_kernel_line("did not sync after")
}

fn sync0_frames(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    let cycle = bench.arguments.cycle_us;
    let text = format!(
        "cycle_us = {cycle}\n[dc]\ncycle_us = {cycle}\nshift_us = {}\n[[gateway]]\nposition = 0\nn = 3\n\
         [gateway.can0]\nbitrate = 1_000_000\n",
        cycle / 2
    );
    run_with_file(bench, "sync0.toml", &text, 1, 1)
}

fn no_warning_without_clocks(bench: &mut Bench) -> Result<(), Stop> {
    run_echo(bench, EchoRun::n(3))?;
    check(bench.kind == Kind::Library || bench.has_kernel_log(), || {
        "the kernel log cannot be read".to_owned()
    })?;
    bench.expect_no_kernel_line("No application time received")
}
