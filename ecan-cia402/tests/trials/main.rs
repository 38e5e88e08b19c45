//! Random trials: machine, application, faults and an operator from a seed, checked by what physically
//! happens at the simulated motors.
//!
//! ```text
//! cargo test -p ecan-cia402 --test trials                                   # 200 seeds
//! TRIALS_FIRST=0 TRIALS_COUNT=20000 cargo test --release -p ecan-cia402 --test trials -- --nocapture
//! TRIALS_FIRST=1234 TRIALS_COUNT=1 cargo test -p ecan-cia402 --test trials trials_violate -- --nocapture   # its log
//! TRIALS_FIRST=1234 TRIALS_COUNT=1 cargo test -p ecan-cia402 --test trials shared -- --nocapture
//! TRIALS_FIRST=1234 TRIALS_COUNT=1 cargo test -p ecan-cia402 --test trials schedules -- --nocapture
//! TRIALS_STEPS=4 cargo test --release -p ecan-cia402 --test trials histories -- --nocapture   # all of four events
//! ```
//!
//! Unlike `axis_properties`, which compares targets with their limits, these trials include the
//! application: skipped calls, a second table on the same Port, a restarted process, commands at any
//! time in any mode. The monitors (`monitor`) read the traces of the drives; `run` documents when a frame
//! could reach a drive. Some gateways differ from the assumptions (`variants`); `TRIALS_VARIANT=KEY=VALUE` gives all
//! of them one alternative of `ecan-sim variants`. `TRIALS_THREADS` is the number of threads; `TRIALS_LOG=2` adds every
//! target and controller period to the log.
#![allow(missing_docs)]

mod bounds;
mod log;
mod monitor;
mod plan;
mod random;
mod report;
mod run;
mod sdk;
mod variants;

use std::time::Instant;

use ecan_test_support::{catch_panic, run_seeds};
use log::Level;
use plan::{Plan, histories};
use report::{Finding, Kind, Outcome, Summary};
use run::Trial;

/// Seeds that found an error, run in addition to the first ones.
///
/// 3913: voltage was disabled while the motor returned from its feed-forward.
/// 4640, 5780: two targets were lost in a bus-off that no image of the gateway showed in time.
/// 43993, 44729: an enabled drive counted as absent at the takeover, since responses were lost.
/// 44419, 45524: a gateway with a service of its own clock sent a target one service period earlier.
/// 45577: more scheduled frames waited in a gateway than its status counts.
/// 46036: a mode change enabled the drive after a path loss in which the drive had stopped without a command.
/// 47971: the owner was replaced while a drive ignored the quick stop.
/// 50537: a gateway that had noted an overflow did not return after it lost its PDO profiles.
/// 51807: a stop at the end of a homing left the axis in another mode than its drive.
/// 60447: more frames waited in a gateway than its status counts, one of them not scheduled.
/// 61652: a gateway with the process data of another one counted as below OP.
/// 67089, 67695, 90041, 114180: the first SYNC after a quick stop executed an RPDO of the earlier owner.
/// 85898: the configuration of a drive that counted as absent lost the response with its state.
/// 92394: the stop before a configuration overtook a target that waited for its SYNC.
/// 101667: a drive restarted during its configuration, and its boot-up message was lost.
/// 104566: seven attempts in a row lost their response while a drive ignored the quick stop.
/// 110672: a target took effect between a sample of the motor and the stop.
/// 121796: three targets were lost in a bus-off while images were damaged.
/// 124644: two targets were lost in a bus-off whose images were lost on their return.
/// 157264: the end of a feed-forward counted as executed in cycles without SYNC.
/// 158055: the drive of a motor that was blocked at the takeover was adopted.
/// 173759: a drive without heartbeat left Operational and was not started again.
/// 2003820: a startup was requested again while the profiles of its gateway were restored.
/// 2005548: an owner ended before its stop left, while a drive opened its brake.
/// 3000081: a drive whose motor was blocked as its owner was replaced in a hold was adopted.
/// 3003029: an adoption enabled a drive again that had stopped by its own watch and stayed in Quick Stop Active.
/// 3401629: a stop waited for the lost response of an inspection.
const FOUND: &[u64] = &[
    3913, 4640, 5780, 43993, 44419, 44729, 45524, 45577, 46036, 47971, 50537, 51807, 60447, 61652,
    67089, 67695, 85898, 90041, 92394, 101667, 104566, 110672, 114180, 121796, 124644, 157264,
    158055, 173759, 2003820, 2005548, 3000081, 3003029, 3401629,
];

/// The same with axes of shared nodes.
///
/// 5346: two targets were lost in a bus-off while images were damaged.
/// 60447: as above.
/// 62312: an earlier command enabled a slow drive while the next one waited.
/// 66800, 75644: an adopted axis was stopped before the channel got SYNC.
/// 91190: the clock of a gateway jumped, and two scheduled targets were lost.
/// 93763: the end of a feed-forward moved a motor that was at rest.
/// 100882: the first target after a hold was the position of a motor beyond its bounds.
/// 126625: an enabled drive that had not answered counted as stopped during its configuration.
/// 3005716: the first targets were lost in a bus-off while images were damaged.
/// 3100293: the SYNC of a skipped cycle was missing.
const FOUND_SHARED: &[u64] =
    &[5346, 60447, 62312, 66800, 75644, 91190, 93763, 100882, 126625, 3005716, 3100293];

/// Seeds of machines with scheduled transmission that violated a rule.
///
/// 2001759: a clock that jumped dropped a target again and again, one at a time.
/// 2006266: with the heartbeat of the host more frames waited for the second pulse than the status counts.
/// 2000109: the time that the host lost counted as time without TPDOs.
/// 1000298: the SYNC of a scheduled target's own image, which leaves before it, counted as the one that made it effective.
/// 1000313, 1000376, 1000445, 1000570, 1001375: the host lost time inside a cycle, and the SYNC of its targets was
/// withdrawn.
/// 1002127: a drive that was silent at the takeover executed an RPDO of its earlier owner with the first SYNC.
/// 2008679: an owner ended before its stop left, while a drive opened its brake.
/// 3001626: as 3003029 above.
/// 3003978: the clock of a gateway was set while its host stood still.
/// 3005091: the queue rejected a SYNC.
/// 3204187: a stop by SDO overtook an RPDO.
/// 3301886: the homing of a drive that ignores the quick stop ended before it began.
/// 3504334: the first target was repeated with each SYNC.
const FOUND_SCHEDULED: &[u64] = &[
    1000298, 1000313, 1000376, 1000445, 1000570, 1001375, 1002127, 2000109, 2001759, 2006266,
    2008679, 3001626, 3003978, 3005091, 3204187, 3301886, 3504334,
];

fn variable(name: &str) -> Option<u64> {
    let value = std::env::var(name).ok()?;
    Some(value.parse().unwrap_or_else(|_| panic!("{name}={value} is not a number")))
}

/// Change of the drawn machines.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Family {
    Plain,
    /// Pairs of axes share a node.
    SharedNodes,
    /// Scheduled transmission, and a host that loses time.
    Scheduled,
    /// Every history of one axis with this many steps of some cycles; a seed is its number.
    Histories {
        steps: u32,
        cycles: u64,
    },
}

impl Family {
    fn plan(self, seed: u64) -> Option<Plan> {
        match self {
            Self::Plain => Some(Plan::draw(seed)),
            Self::SharedNodes => Plan::draw(seed).with_shared_nodes(),
            Self::Scheduled => Some(Plan::draw(seed).with_schedule()),
            Self::Histories { steps, cycles } => Some(Plan::history(seed, steps, cycles)),
        }
    }
}

fn trial(seed: u64, family: Family, level: Level) -> (Outcome, String) {
    let run = || match family.plan(seed) {
        Some(plan) => Trial::run(plan, level),
        None => (Outcome::default(), String::new()),
    };
    catch_panic(run).unwrap_or_else(|text| {
        let finding = Finding { kind: Kind::Panic, axis: 0, at_ns: 0, text };
        (Outcome { findings: vec![finding], ..Outcome::default() }, String::new())
    })
}

#[test]
fn random_trials_violate_no_rule() {
    run_trials(200, FOUND, Family::Plain);
}

/// The same machines with two axes per node where a channel has two.
#[test]
fn random_trials_of_shared_nodes_violate_no_rule() {
    run_trials(100, FOUND_SHARED, Family::SharedNodes);
}

/// Two to five axes on a channel, targets or SYNC at phases of Sync0, and a host that loses time.
#[test]
fn random_trials_with_schedules_violate_no_rule() {
    run_trials(100, FOUND_SCHEDULED, Family::Scheduled);
}

/// In steps of a cycle, in which nothing has settled, or of `TRIALS_CYCLES`.
#[test]
fn short_histories_violate_no_rule() {
    let steps = variable("TRIALS_STEPS").unwrap_or(2) as u32;
    let cycles = variable("TRIALS_CYCLES").unwrap_or(1);
    run_trials(histories::count(steps), &[], Family::Histories { steps, cycles });
}

fn run_trials(count: u64, found: &[u64], family: Family) {
    let first = variable("TRIALS_FIRST").unwrap_or(0);
    let count = variable("TRIALS_COUNT").unwrap_or(count);
    let level = match variable("TRIALS_LOG").unwrap_or(u64::from(count == 1)) {
        0 => Level::Off,
        1 => Level::Events,
        _ => Level::Motion,
    };
    let threads = variable("TRIALS_THREADS").map(|threads| threads as usize);
    let found = if variable("TRIALS_FIRST").is_none() { found } else { &[] };
    let seeds = found.iter().copied().chain(first..first + count);
    let reported = |seed| {
        let (outcome, log) = trial(seed, family, level);
        if level > Level::Off {
            println!("{log}");
        }
        for finding in &outcome.findings {
            println!(
                "TRIALS_FIRST={seed} TRIALS_COUNT=1: {:?}, axis {}, {} ms: {}",
                finding.kind,
                finding.axis,
                finding.at_ns / 1_000_000,
                finding.text
            );
        }
        outcome
    };
    let begin = Instant::now();
    let print = |line: &str| println!("{line}");
    let mut summary = run_seeds(seeds, threads, || false, reported, Summary::default(), print);
    let seconds = begin.elapsed().as_secs_f64();
    println!("{}", summary.text());
    println!("{:.0} simulated seconds in {seconds:.0} s", summary.simulated_s());
    assert!(summary.failed.is_empty(), "violations in seeds {:?}", summary.failed);
}
