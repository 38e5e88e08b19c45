//! Other programs in parallel with the one that runs the cycle.

use std::process::Command;
use std::time::Duration;

use crate::bench::Bench;
use crate::bus::BusSpec;
use crate::need::Need;
use crate::step::{Group, Step};
use crate::steps::running_loop::RunningLoop;
use crate::stop::Stop;

pub const GROUP: Group = Group {
    name: "second_program",
    steps: &[
        Step {
            name: "reads",
            proves: "A second program scans, reads objects and diagnoses; the cycle loses no frame.",
            needs: &[Need::LastingBus, Need::EchoNodes],
            run: reads,
        },
        Step {
            name: "owner",
            proves: "A second program that needs the master is rejected with the reason.",
            needs: &[Need::LastingBus, Need::EchoNodes],
            run: owner,
        },
        Step {
            name: "tool",
            proves: "IgH's tool reads an object while the cycle runs.",
            needs: &[Need::LastingBus, Need::EchoNodes, Need::EthercatTool],
            run: tool,
        },
    ],
};

/// Acts while a program exchanges frames, which must all arrive.
fn during_exchange(
    bench: &mut Bench,
    act: impl FnOnce(&mut Bench) -> Result<(), Stop>,
) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    let running = RunningLoop::start(bench, 1)?;
    let outcome = act(bench);
    // The frames of the last cycles return.
    bench.pause(Duration::from_millis(200))?;
    let ended = running.end(bench);
    outcome.and(ended.and_then(|ended| ended.expect_complete(1)))
}

fn succeed(bench: &mut Bench, commands: Vec<(Command, &[i32])>) -> Result<(), Stop> {
    for (command, codes) in commands {
        bench.run(command)?.expect_one_of(codes)?;
    }
    Ok(())
}

fn reads(bench: &mut Bench) -> Result<(), Stop> {
    during_exchange(bench, |bench| {
        let commands: Vec<(Command, &[i32])> = vec![
            (bench.ecan(["scan"]), &[0]),
            (bench.ecan_first(["info"]), &[0]),
            (bench.ecan_first(["sdo", "read", "0xF000:18"]), &[0]),
            (bench.ecan_first(["diag", "--brief"]), &[0, 1]),
        ];
        succeed(bench, commands)
    })
}

fn owner(bench: &mut Bench) -> Result<(), Stop> {
    during_exchange(bench, |bench| {
        let send = bench.ecan_first(["send", "123#11"]);
        bench.run(send)?.expect(3)?;
        let program = bench.example("simple_loop", ["--cycles", "10"]);
        bench.run(program)?.expect(1).map(drop)
    })
}

fn tool(bench: &mut Bench) -> Result<(), Stop> {
    during_exchange(bench, |bench| {
        let upload = bench.ethercat(["upload", "-p", "0", "--type", "uint16", "0xF000", "18"]);
        bench.run(upload)?.expect(0)?.expect_text("24").map(drop)
    })
}
