//! Long series of outages during a replay.

use std::time::Duration;

use crate::bench::Bench;
use crate::bus::BusSpec;
use crate::need::Need;
use crate::step::{Group, Step};
use crate::steps::distribution::Distribution;
use crate::steps::faults::with_link_down;
use crate::steps::running_loop::RunningLoop;
use crate::stop::Stop;

pub const GROUP: Group = Group {
    name: "outages",
    steps: &[
        Step {
            name: "power_cycles",
            proves: "After each of many power cycles during a replay the gateway becomes ready, and every frame is accounted.",
            needs: &[Need::LastingBus, Need::EchoNodes],
            run: power_cycles,
        },
        Step {
            name: "link_losses",
            proves: "After each of many link losses during a replay the gateway becomes ready, and every frame is accounted.",
            needs: &[Need::Wire, Need::Root, Need::System("ip")],
            run: link_losses,
        },
    ],
};

/// Longest outage.
const LONGEST: Duration = Duration::from_secs(4);
/// Length of the recording for each outage.
const PER_OUTAGE_S: u32 = 60;

fn outages(bench: &Bench) -> u32 {
    bench.arguments.outages.unwrap_or(if bench.arguments.quick { 2 } else { 50 })
}

fn series(
    bench: &mut Bench,
    mut outage: impl FnMut(&mut Bench, Duration) -> Result<(), Stop>,
) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    let count = outages(bench);
    let frames = count * PER_OUTAGE_S * (1_000_000 / bench.arguments.cycle_us);
    let log = super::recording(bench, frames)?;
    let mut running = RunningLoop::start_with(bench, 1, &["--replay", &log])?;
    let mut times = Distribution::default();
    for nth in 1..=count {
        let pause = bench.random_time(LONGEST);
        bench.pause(pause)?;
        let mark = running.mark();
        let length = bench.random_time(LONGEST);
        outage(bench, length)?;
        match running.wait_ready_again(bench, mark) {
            Ok(time) => times.add(time),
            Err(Stop::Failed(message)) => {
                times.report(bench, "ready_again");
                let _ = running.end(bench);
                return Err(Stop::Failed(format!(
                    "outage {nth} of {count}, {length:?}: {message}"
                )));
            }
            Err(other) => return Err(other),
        }
    }
    times.report(bench, "ready_again");
    running.end(bench)?.expect_accounts_of_replay(1)
}

fn power_cycles(bench: &mut Bench) -> Result<(), Stop> {
    series(bench, |bench, length| bench.power_cycle(Duration::from_millis(100) + length))
}

fn link_losses(bench: &mut Bench) -> Result<(), Stop> {
    // Shorter than the watchdog of the gateway: nothing is lost then, so nothing becomes ready again.
    let shortest = Duration::from_millis(500);
    series(bench, |bench, length| with_link_down(bench, shortest + length))
}
