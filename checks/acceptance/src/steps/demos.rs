//! The manual's programs, in Rust and in C.

use crate::bench::Bench;
use crate::bus::BusSpec;
use crate::need::Need;
use crate::step::{Group, Step};
use crate::steps::echo::{EchoRun, run_echo};
use crate::stop::{Stop, check};

pub const GROUP: Group = Group {
    name: "demos",
    steps: &[
        Step {
            name: "sdo_probe",
            proves: "An object of a CANopen drive is read through the gateway.",
            needs: &[Need::Simulated],
            run: |bench| sdo_probe(bench, "canopen_sdo_probe"),
        },
        Step {
            name: "single_axis",
            proves: "A CiA 402 drive is configured, enabled, moved and disabled.",
            needs: &[Need::Simulated],
            run: |bench| axes(bench, "cia402_single_axis_demo", 1, 1),
        },
        Step {
            name: "ten_axes",
            proves: "Ten drives on three gateways are enabled, moved and disabled.",
            needs: &[Need::Simulated, Need::Gateways(3)],
            run: |bench| axes(bench, "cia402_10axis_demo", 3, 10),
        },
        Step {
            name: "ten_axes_sync0",
            proves: "Ten drives move with Sync0, and the cycle follows the reference clock.",
            needs: &[Need::Simulated, Need::Gateways(3)],
            run: ten_axes_sync0,
        },
        Step {
            name: "tx_probe",
            proves: "Frames leave directly and at their phase of Sync0, and their results are reported.",
            needs: &[Need::EchoNodes],
            run: tx_probe,
        },
        Step {
            name: "replay",
            proves: "Each frame of a recording returns.",
            needs: &[Need::EchoNodes],
            run: replay,
        },
        Step {
            name: "c_loop",
            proves: "The C program of the main loop delivers every frame and receives it again.",
            needs: &[Need::EchoNodes, Need::Program("igh_simple_loop")],
            run: |bench| run_echo(bench, EchoRun { program: "igh_simple_loop", ..EchoRun::n(3) }),
        },
        Step {
            name: "c_sdo_probe",
            proves: "The C program reads an object of a CANopen drive.",
            needs: &[Need::Simulated, Need::Program("igh_canopen_sdo_probe")],
            run: |bench| sdo_probe(bench, "igh_canopen_sdo_probe"),
        },
        Step {
            name: "c_single_axis",
            proves: "The C program configures, enables, moves and disables a drive.",
            needs: &[Need::Simulated, Need::Program("igh_cia402_single_axis_demo")],
            run: |bench| axes(bench, "igh_cia402_single_axis_demo", 1, 1),
        },
        Step {
            name: "c_ten_axes",
            proves: "The C program moves ten drives on three gateways.",
            needs: &[Need::Simulated, Need::Gateways(3), Need::Program("igh_cia402_10axis_demo")],
            run: |bench| axes(bench, "igh_cia402_10axis_demo", 3, 10),
        },
        Step {
            name: "c_tx_probe",
            proves: "The C program sends scheduled frames with Sync0.",
            needs: &[Need::EchoNodes, Need::Program("igh_mcan_gateway_tx_probe")],
            run: c_tx_probe,
        },
    ],
};

/// Device type of a CiA 402 drive, 0x1000, in its low word.
const CIA402: &str = "0192";

fn sdo_probe(bench: &mut Bench, program: &str) -> Result<(), Stop> {
    bench.bus(BusSpec::drives(1))?;
    let command = bench.cyclic_example(program, ["--node", "1", "--index", "0x1000"]);
    bench.run(command)?.expect(0)?.expect_text(CIA402).map(drop)
}

/// Step of an axis per target.
const STEP: u64 = 50;

fn axes(bench: &mut Bench, program: &str, gateways: u16, count: usize) -> Result<(), Stop> {
    run_axes(bench, program, gateways, count, &[])
}

fn ten_axes_sync0(bench: &mut Bench) -> Result<(), Stop> {
    run_axes(bench, "cia402_10axis_demo", 3, 10, &["--dc-sync0", "--dc-follow"])?;
    bench.expect_no_kernel_line("did not sync after")
}

fn run_axes(
    bench: &mut Bench,
    program: &str,
    gateways: u16,
    count: usize,
    options: &[&str],
) -> Result<(), Stop> {
    bench.bus(BusSpec::drives(gateways))?;
    let step = STEP.to_string();
    let mut command = bench.cyclic_example(program, ["--step", &step, "--cycles", "200"]);
    command.args(options);
    let finished = bench.run(command)?.expect(0)?;
    if let Some(seconds) = finished.time_of("all axes enabled") {
        bench.figure("axes_enabled_s", seconds);
    }
    let output = finished.output();
    let enabled = output.lines().filter(|line| {
        line.starts_with(|first: char| first.is_ascii_digit()) && line.contains("operation enabled")
    });
    let enabled = enabled.count();
    check(enabled == count, || {
        format!("{enabled} of {count} axes in operation enabled: {}", finished.end_text())
    })
}

fn tx_probe(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    let program = bench.cyclic_example("mcan_gateway_tx_probe", ["--frames", "200"]);
    bench.run(program)?.expect(0)?.expect_text("results of 200 frames").map(drop)
}

fn c_tx_probe(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    let arguments = ["--frames", "200", "--offset-ns", "100000"];
    let program = bench.cyclic_example("igh_mcan_gateway_tx_probe", arguments);
    bench.run(program)?.expect(0).map(drop)
}

fn replay(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    let log = crate::steps::recording(bench, if bench.arguments.quick { 200 } else { 2_000 })?;
    let program = bench.cyclic_example("simple_loop", ["--replay", &log]);
    bench.run(program)?.expect(0).map(drop)
}
