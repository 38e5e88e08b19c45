//! From the start of a program to OP and the first frames.

use crate::bench::Bench;
use crate::bus::BusSpec;
use crate::need::Need;
use crate::step::{Group, Run, Step};
use crate::steps::echo::{EchoRun, count_echo, run_echo};
use crate::stop::{Stop, check};

pub const GROUP: Group = Group {
    name: "startup",
    steps: &[
        echo(
            "n1",
            "One gateway with N = 1 reaches OP; every frame is delivered and returns.",
            |bench| run_echo(bench, EchoRun::n(1)),
        ),
        echo(
            "n3",
            "One gateway with N = 3 reaches OP; every frame is delivered and returns.",
            |bench| run_echo(bench, EchoRun::n(3)),
        ),
        echo(
            "n8",
            "One gateway with N = 8, LWR and LRD instead of LRW, returns every frame.",
            |bench| run_echo(bench, EchoRun::n(8)),
        ),
        echo(
            "n11",
            "One gateway with N = 11, the largest that the master carries, returns every frame.",
            |bench| run_echo(bench, EchoRun::n(11)),
        ),
        Step {
            name: "n12_rejected",
            proves: "N = 12 is rejected before the bus is touched, with the reason.",
            needs: &[],
            run: n12_rejected,
        },
        echo("fd", "CAN FD frames with 64 bytes and bit rate switch return complete.", |bench| {
            run_echo(bench, EchoRun { options: &["--fd", "5000000"], ..EchoRun::n(8) })
        }),
        echo(
            "all_channels",
            "All four channels of a gateway carry frames at the same time.",
            |bench| run_echo(bench, EchoRun { channels: 4, ..EchoRun::n(3) }),
        ),
        Step {
            name: "three_gateways",
            proves: "Three gateways with four channels each reach OP and return every frame.",
            needs: &[Need::EchoNodes, Need::Gateways(3)],
            run: |bench| run_echo(bench, EchoRun { gateways: 3, channels: 4, ..EchoRun::n(5) }),
        },
        Step {
            name: "six_gateways",
            proves: "Six gateways reach OP and return every frame.",
            needs: &[Need::EchoNodes, Need::Gateways(6)],
            run: |bench| run_echo(bench, EchoRun { gateways: 6, ..EchoRun::n(3) }),
        },
        Step {
            name: "counters_of_the_slave",
            proves: "The frames that the host counts as delivered are those on the gateway's CAN bus.",
            needs: &[Need::Wire],
            run: counters_of_the_slave,
        },
        Step {
            name: "wrong_identity",
            proves: "A gateway with another identity than the configured one is rejected by name.",
            needs: &[],
            run: wrong_identity,
        },
    ],
};

/// A step with frames that return.
const fn echo(name: &'static str, proves: &'static str, run: Run) -> Step {
    Step { name, proves, needs: &[Need::EchoNodes], run }
}

fn n12_rejected(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let program = bench.example("simple_loop", ["--pdo-n", "12", "--cycles", "10"]);
    bench.run(program)?.expect(1)?.expect_text("1486").map(drop)
}

fn counters_of_the_slave(bench: &mut Bench) -> Result<(), Stop> {
    bench.fresh_bus(BusSpec::echo(1))?;
    let frames = count_echo(bench, EchoRun::n(3))?;
    let Some(report) = bench.stop_slave()? else {
        return Err(Stop::failed("the simulated gateways have ended unexpectedly"));
    };
    let counted =
        (report.sent_to_bus(0, 0), report.received_from_bus(0, 0), report.faulty_frames());
    let expected = (Some(frames), Some(frames), Some(0));
    check(counted == expected, || {
        format!("(sent, received, faulty) of the gateway {counted:?}, of the host {expected:?}")
    })
}

fn wrong_identity(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let file = bench.write_file(
        "identity.toml",
        "[[gateway]]\nposition = 0\nn = 3\nidentity = { vendor_id = 0x1234, product_code = 0x5678 }\n\
         [gateway.can0]\nbitrate = 1_000_000\n",
    )?;
    let program = bench.example("simple_loop", ["--cycles", "10", "--config", &file]);
    bench.run(program)?.expect(1)?.expect_text("identity").map(drop)
}
