//! Programs in quick succession.

use std::time::Duration;

use crate::bench::Bench;
use crate::bus::BusSpec;
use crate::need::Need;
use crate::step::{Group, Step};
use crate::steps::distribution::Distribution;
use crate::steps::running_loop::RunningLoop;
use crate::stop::Stop;

pub const GROUP: Group = Group {
    name: "restarts",
    steps: &[
        Step {
            name: "starts_in_a_row",
            proves: "Each of many starts, 0 to 5 s after the end of the last program, becomes ready.",
            needs: &[Need::LastingBus, Need::EchoNodes],
            run: starts_in_a_row,
        },
        Step {
            name: "after_kill",
            proves: "A program starts at once after another one was killed.",
            needs: &[Need::LastingBus, Need::EchoNodes],
            run: after_kill,
        },
        Step {
            name: "commands_in_a_row",
            proves: "Commands that read and programs that own the master follow each other at once.",
            needs: &[Need::LastingBus, Need::EchoNodes],
            run: commands_in_a_row,
        },
        Step {
            name: "three_gateways",
            proves: "Starts with three gateways, right after the end of the last program, become ready.",
            needs: &[Need::LastingBus, Need::EchoNodes, Need::Gateways(3), Need::Full],
            run: three_gateways,
        },
    ],
};

/// Longest pause before a start.
const PAUSE: Duration = Duration::from_secs(5);

fn starts(bench: &Bench) -> u32 {
    bench.arguments.starts.unwrap_or(if bench.arguments.quick { 5 } else { 100 })
}

/// Starts the program, waits until it is ready, ends it; `nth` is part of the message of a failure.
fn start_once(
    bench: &mut Bench,
    gateways: u16,
    nth: u32,
    times: &mut Distribution,
) -> Result<(), Stop> {
    let name = |stop| match stop {
        Stop::Failed(message) => Stop::Failed(format!("start {nth}: {message}")),
        other => other,
    };
    let mut running = RunningLoop::launch(bench, gateways)?;
    let ready = running.wait_ready(bench);
    bench.pause(Duration::from_millis(100))?;
    let ended = running.end(bench)?;
    times.add(ready.map_err(name)?);
    ended.expect_accounts(gateways).map_err(name)
}

/// Runs all starts; a failed one does not end the series.
fn series(
    bench: &mut Bench,
    gateways: u16,
    count: u32,
    mut before: impl FnMut(&mut Bench) -> Result<(), Stop>,
) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(gateways))?;
    let (mut times, mut failures) = (Distribution::default(), Vec::new());
    for nth in 1..=count {
        before(bench)?;
        match start_once(bench, gateways, nth, &mut times) {
            Err(Stop::Failed(message)) => failures.push(message),
            other => other?,
        }
    }
    times.report(bench, "ready");
    match failures.first() {
        None => Ok(()),
        Some(first) => {
            Err(Stop::Failed(format!("{} of {count} starts failed; {first}", failures.len())))
        }
    }
}

fn starts_in_a_row(bench: &mut Bench) -> Result<(), Stop> {
    let count = starts(bench);
    series(bench, 1, count, |bench| {
        let time = bench.random_time(PAUSE);
        bench.pause(time)
    })
}

fn three_gateways(bench: &mut Bench) -> Result<(), Stop> {
    let count = starts(bench).div_ceil(10);
    series(bench, 3, count, |_| Ok(()))
}

fn after_kill(bench: &mut Bench) -> Result<(), Stop> {
    let count = starts(bench).div_ceil(5);
    series(bench, 1, count, |bench| {
        let running = RunningLoop::launch(bench, 1)?;
        let time = bench.random_time(PAUSE);
        bench.pause(time)?;
        running.kill(bench)
    })
}

fn commands_in_a_row(bench: &mut Bench) -> Result<(), Stop> {
    let count = starts(bench).div_ceil(5);
    series(bench, 1, count, |bench| {
        for arguments in [&["scan"][..], &["--slave", "0", "info"]] {
            let command = bench.ecan(arguments);
            bench.run(command)?.expect(0)?;
        }
        Ok(())
    })
}
