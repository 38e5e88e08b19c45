//! How late the cycle starts, against `cyclictest` on the same machine.
//!
//! Segments of both alternate, since a machine has better and worse minutes; what counts is the
//! median of the ratios of neighbours. Needs `cyclictest` (Debian: rt-tests) and the right to
//! SCHED_FIFO; without either it says so and tells the own figures alone.
//!
//!     cargo bench -p ecan-host --bench wake_up -- [SEGMENTS [CYCLES]]
#![allow(missing_docs)]

use std::process::Command;

use ecan_bench::measure::{Row, median, print_rows, rounds};
use ecan_host::{
    Clock, CycleStatistics, CycleTimer, CycleTiming, MonotonicClock, OverrunPolicy, RealTimeConfig,
};

const CYCLE_NS: u32 = 1_000_000;
const SPIN_NS: u64 = 100_000;
const PRIORITY: u8 = 80;
const SEGMENTS: usize = 20;
const CYCLES: usize = 2_000;
/// Longest delay that cyclictest tells apart, in microseconds.
const LONGEST_US: usize = 10_000;

/// Delays of one segment, in nanoseconds.
#[derive(Clone, Copy)]
struct Delays {
    p50: f64,
    p99: f64,
}

/// A segment of the own cycle, on a thread of its own.
fn own(cycles: usize, spin_ns: u64) -> (Delays, String) {
    let segment = move || {
        let settings = RealTimeConfig {
            priority: Some(PRIORITY),
            lock_memory: Some(64 * 1024),
            wake_up_latency_us: Some(0),
            ..RealTimeConfig::default()
        };
        let report = settings.apply().expect("nothing is required").to_string();
        let clock = MonotonicClock;
        let timing = CycleTiming { spin_ns, overrun: OverrunPolicy::Skip };
        let mut timer = CycleTimer::new(CYCLE_NS, timing);
        let mut statistics = CycleStatistics::new(CYCLE_NS);
        for _ in 0..cycles {
            statistics.begin(&timer.wait(&clock));
            statistics.end(clock.now_ns());
        }
        let delays = statistics.wake_up();
        (Delays { p50: delays.p50_ns as f64, p99: delays.p99_ns as f64 }, report)
    };
    std::thread::spawn(segment).join().expect("the segment does not panic")
}

/// A segment of cyclictest, from its histogram of whole microseconds.
fn cyclictest(cycles: usize) -> Result<Delays, String> {
    let output = Command::new("cyclictest")
        .args(["--quiet", "--mlockall", "--policy=fifo"])
        .args([format!("--priority={PRIORITY}"), format!("--interval={}", CYCLE_NS / 1_000)])
        .args([format!("--loops={cycles}"), format!("--histogram={LONGEST_US}")])
        .output()
        .map_err(|error| format!("cyclictest cannot be started: {error}"))?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).trim().to_owned());
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let counts: Vec<(usize, usize)> = text
        .lines()
        .filter(|line| line.starts_with(|c: char| c.is_ascii_digit()))
        .filter_map(|line| {
            let mut words = line.split_whitespace().map(str::parse);
            Some((words.next()?.ok()?, words.next()?.ok()?))
        })
        .collect();
    let total: usize = counts.iter().map(|(_, count)| count).sum();
    if total == 0 {
        return Err("cyclictest told no histogram".to_owned());
    }
    // Rounded down by cyclictest, so in the mean half a microsecond more.
    let at = |share: f64| {
        let mut left = (total as f64 * share).ceil() as usize;
        let place = counts.iter().find(|(_, count)| {
            left = left.saturating_sub(*count);
            left == 0
        });
        place.map_or(LONGEST_US as f64, |(us, _)| *us as f64 + 0.5) * 1_000.0
    };
    Ok(Delays { p50: at(0.5), p99: at(0.99) })
}

fn main() {
    let mut numbers = std::env::args().filter_map(|argument| argument.parse::<usize>().ok());
    let segments = numbers.next().unwrap_or_else(|| rounds(SEGMENTS));
    let cycles = numbers.next().unwrap_or(CYCLES);
    let (mut plain, mut spun, mut peers, mut peer_fault) = (vec![], vec![], vec![], None);
    for segment in 0..segments {
        let (delays, report) = own(cycles, 0);
        if segment == 0 {
            eprintln!("{report}");
        }
        plain.push(delays);
        match cyclictest(cycles) {
            Ok(delays) => peers.push(delays),
            Err(fault) => peer_fault = Some(fault),
        }
        spun.push(own(cycles, SPIN_NS).0);
    }
    let us =
        |of: &[Delays], pick: fn(&Delays) -> f64| median(of.iter().map(pick).collect()) / 1_000.0;
    println!("delay of the cycle at 1 ms, {segments} segments of {cycles} cycles each, medians");
    println!("                     p50          p99");
    for (name, of) in [("own", &plain), ("own, 100 us spin", &spun), ("cyclictest", &peers)] {
        if !of.is_empty() {
            println!("{name:17} {:8.1} us  {:8.1} us", us(of, |d| d.p50), us(of, |d| d.p99));
        }
    }
    if let Some(fault) = peer_fault {
        println!("no comparison: {fault}");
        return;
    }
    let ratio = |of: &[Delays], pick: fn(&Delays) -> f64| {
        median(of.iter().zip(&peers).map(|(own, peer)| pick(own) / pick(peer)).collect())
    };
    let row = |name, goal, value| {
        Row::new(name, "cycle timer / cyclictest", value).with_goals(goal, goal)
    };
    print_rows(&[
        row("wake-up at 1 ms, p50", 1.1, ratio(&plain, |d| d.p50)),
        row("wake-up at 1 ms, p99", 1.2, ratio(&plain, |d| d.p99)),
        row("wake-up at 1 ms, p99, 100 us spin", 0.1, ratio(&spun, |d| d.p99)),
    ]);
}
