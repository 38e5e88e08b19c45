//! The cycle timer on the stepped clock: exact points, whatever the cycles take.

use std::time::Duration;

use std::cell::Cell;
use std::sync::Mutex;

use crate::common::{open, raw_config, raw_config_of, run, simulated};
use ecan_host::{
    Adapter, Clock, CycleStart, CycleTimer, CycleTiming, Ecrt, MAX_SPIN_NS, OverrunPolicy, Plan,
    StartupPlan,
};
use ecan_sim::{Scenario, WakeUpDelay};
use proptest::prelude::*;

const CYCLE_NS: u64 = 1_000_000;

fn with_policy(overrun: OverrunPolicy) -> CycleTiming {
    CycleTiming { overrun, ..CycleTiming::default() }
}

fn catch_up(max_cycles: u32) -> CycleTiming {
    with_policy(OverrunPolicy::CatchUp { max_cycles })
}

/// A timer whose first cycle took so long; the starts of the cycles after it, which take no time.
/// Points are relative to the first.
fn starts_after(timing: CycleTiming, work_ns: u64, count: usize) -> Vec<CycleStart> {
    let ecrt: Ecrt = simulated(ecan_sim::echo(1)).0;
    let clock = ecrt.clock();
    let mut timer = CycleTimer::new(CYCLE_NS as u32, timing);
    let first = timer.wait(clock.as_ref());
    assert_eq!((first.late_ns, first.skipped, first.has_overrun), (0, 0, false));
    clock.sleep_until_ns(first.deadline_ns + work_ns);
    let from_first = |start: CycleStart| CycleStart {
        deadline_ns: start.deadline_ns - first.deadline_ns,
        ..start
    };
    (0..count).map(|_| from_first(timer.wait(clock.as_ref()))).collect()
}

fn start(point: u64, late_ns: u64, skipped: u64, has_overrun: bool) -> CycleStart {
    CycleStart { deadline_ns: point * CYCLE_NS, late_ns, skipped, has_overrun }
}

#[test]
fn timer_reports_its_cycle() {
    let cycle_ns = |cycle_ns| CycleTimer::new(cycle_ns, CycleTiming::default()).cycle_ns();
    assert_eq!((cycle_ns(250_000), cycle_ns(0)), (250_000, 1));
}

#[test]
fn cycle_in_time_keeps_the_grid() {
    for timing in [CycleTiming::default(), catch_up(0), catch_up(3)] {
        let starts = starts_after(timing, 300_000, 2);
        assert_eq!(starts, [start(1, 0, 0, false), start(2, 0, 0, false)], "{timing:?}");
    }
}

#[test]
fn missed_deadlines_are_skipped() {
    for timing in [CycleTiming::default(), catch_up(0)] {
        let starts = starts_after(timing, 1_700_000, 2);
        assert_eq!(starts, [start(2, 0, 1, true), start(3, 0, 0, false)], "{timing:?}");
        let starts = starts_after(timing, 5_200_000, 2);
        assert_eq!(starts, [start(6, 0, 5, true), start(7, 0, 0, false)], "{timing:?}");
    }
}

#[test]
fn missed_deadlines_are_caught_up() {
    let starts = starts_after(catch_up(10), 1_700_000, 2);
    assert_eq!(starts, [start(1, 700_000, 0, true), start(2, 0, 0, false)]);
    let starts = starts_after(catch_up(10), 5_200_000, 6);
    let expected = [
        start(1, 4_200_000, 0, true),
        start(2, 3_200_000, 0, false),
        start(3, 2_200_000, 0, false),
        start(4, 1_200_000, 0, false),
        start(5, 200_000, 0, false),
        start(6, 0, 0, false),
    ];
    assert_eq!(starts, expected);
}

#[test]
fn catching_up_is_bounded() {
    let starts = starts_after(catch_up(3), 5_200_000, 4);
    let expected = [
        start(3, 2_200_000, 2, true),
        start(4, 1_200_000, 0, false),
        start(5, 200_000, 0, false),
        start(6, 0, 0, false),
    ];
    assert_eq!(starts, expected);
}

#[test]
fn overrun_while_catching_up_counts_again() {
    let ecrt = simulated(ecan_sim::echo(1)).0;
    let clock = ecrt.clock();
    let mut timer = CycleTimer::new(CYCLE_NS as u32, catch_up(10));
    let first = timer.wait(clock.as_ref()).deadline_ns;
    let mut overruns = Vec::new();
    for work_ns in [2_500_000, 100_000, 1_500_000, 0, 0, 0] {
        clock.sleep_until_ns(clock.now_ns() + work_ns);
        let start = timer.wait(clock.as_ref());
        overruns.push((start.has_overrun, (start.deadline_ns - first) / CYCLE_NS));
    }
    let expected = [(true, 1), (false, 2), (true, 3), (false, 4), (false, 5), (false, 6)];
    assert_eq!(overruns, expected);
}

#[test]
fn restart_moves_the_grid() {
    let ecrt = simulated(ecan_sim::echo(1)).0;
    let clock = ecrt.clock();
    let mut timer = CycleTimer::new(CYCLE_NS as u32, CycleTiming::default());
    timer.wait(clock.as_ref());
    let moved = clock.now_ns() + 123_456;
    clock.sleep_until_ns(moved);
    timer.restart();
    assert_eq!(timer.wait(clock.as_ref()).deadline_ns, moved);
    assert_eq!(timer.wait(clock.as_ref()).deadline_ns, moved + CYCLE_NS);
}

/// A clock that goes on by 10 us with every look at it.
struct Looked {
    now_ns: Mutex<Cell<u64>>,
    slept_until_ns: Mutex<Cell<u64>>,
}

impl Clock for Looked {
    fn now_ns(&self) -> u64 {
        let now = self.now_ns.lock().unwrap();
        now.set(now.get() + 10_000);
        now.get()
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        self.slept_until_ns.lock().unwrap().set(deadline_ns);
        let now = self.now_ns.lock().unwrap();
        now.set(now.get().max(deadline_ns));
    }

    fn is_free_running(&self) -> bool {
        true
    }
}

#[test]
fn free_running_clock_sleeps_until_the_spin_then_polls() {
    let clock = Looked { now_ns: Mutex::default(), slept_until_ns: Mutex::default() };
    let timing = CycleTiming { spin_ns: 100_000, ..CycleTiming::default() };
    let mut timer = CycleTimer::new(CYCLE_NS as u32, timing);
    timer.wait(&clock);
    let start = timer.wait(&clock);
    let slept = clock.slept_until_ns.lock().unwrap().get();
    assert_eq!(slept, start.deadline_ns - 100_000);
    assert_eq!(start.late_ns, 10_000, "one look more than the ten that the spin takes");

    timer.set_timing(CycleTiming { spin_ns: u64::MAX, ..timing });
    assert_eq!(timer.timing().spin_ns, MAX_SPIN_NS);
}

#[test]
fn adapter_waits_with_the_cycle_timer() {
    let mut config = raw_config().0;
    config.cycle = Duration::from_nanos(CYCLE_NS);
    let mut adapter: Adapter = open(ecan_sim::echo(1), config).unwrap();
    adapter.wait_op(Duration::from_secs(10)).unwrap();
    run(&mut adapter, 3);
    let before = adapter.cycle_start().deadline_ns;
    adapter.set_cycle_timing(CycleTiming { spin_ns: 100_000, ..catch_up(2) });
    let clock = adapter.ecrt().clock().clone();
    clock.sleep_until_ns(clock.now_ns() + 5_200_000);
    let mut points = Vec::new();
    for _ in 0..3 {
        let skipped = adapter.wait_next_cycle();
        adapter.receive().unwrap();
        adapter.send().unwrap();
        let start = adapter.cycle_start();
        assert_eq!(
            adapter.cycle_time_ns(),
            start.deadline_ns,
            "the time of the cycle is its point"
        );
        points.push(((start.deadline_ns - before) / CYCLE_NS, skipped));
    }
    assert_eq!(points, [(4, 3), (5, 0), (6, 0)]);
}

/// A busy machine wakes up shortly before the next point, or behind several.
#[test]
fn cycle_after_a_late_one_waits_for_the_response() {
    const BUSY: WakeUpDelay =
        WakeUpDelay { typical_ns: 1_000, p99_ns: 990_000, longest_ns: 5_000_000 };
    for timing in [CycleTiming::default(), catch_up(10)] {
        let scenario = Scenario { wake_up: Some(BUSY), ..ecan_sim::echo(1) };
        let mut adapter = open(scenario, raw_config().0).unwrap();
        adapter.set_cycle_timing(timing);
        adapter.wait_op(Duration::from_secs(10)).unwrap();
        let mut overruns = 0;
        for cycle in 0..10_000 {
            adapter.wait_next_cycle();
            let start = adapter.cycle_start();
            overruns += usize::from(start.has_overrun);
            adapter.receive().unwrap();
            assert!(adapter.domain_is_complete(), "{timing:?} {cycle}: {start:?}");
            adapter.send().unwrap();
        }
        assert!(overruns > 20, "{overruns}");
    }
}

/// Whatever share of the cycle the wire takes: a host that leaves the answer its time keeps the
/// grid, one that was late comes back to it, and no answer is lost.
#[test]
fn early_send_is_never_delayed() {
    for (gateways, multiplier, cycle_us) in
        [(1, 8, 250), (1, 2, 100), (3, 11, 1_000), (1, 3, 200_u32)]
    {
        let config =
            raw_config_of(gateways, multiplier).with_cycle(Duration::from_micros(cycle_us.into()));
        let (ecrt, simulation) = simulated(ecan_sim::echo(gateways.into()));
        let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
        adapter.wait_op(Duration::from_secs(60)).unwrap();
        let cycle_ns = u64::from(cycle_us) * 1_000;
        let rest_ns = cycle_ns - Plan::of(adapter.config()).wire_ns();
        let case = format!("{gateways} {multiplier} {cycle_us}");
        let mut cycle = |work_ns| {
            let skipped = adapter.wait_next_cycle();
            adapter.receive().unwrap();
            assert!(adapter.domain_is_complete(), "{case}");
            simulation.pass_ns(work_ns);
            adapter.send().unwrap();
            (adapter.cycle_start(), skipped)
        };
        let in_time = |(start, skipped): (CycleStart, u64)| {
            (start.late_ns, start.has_overrun, skipped) == (0, false, 0)
        };
        for _ in 0..2_000 {
            assert!(in_time(cycle(rest_ns / 2)), "{case}");
        }
        cycle(cycle_ns * 9 / 10);
        let (start, skipped) = cycle(0);
        assert_eq!((start.late_ns, start.has_overrun, skipped), (0, true, 1), "{case}");
        assert!((0..100).all(|_| in_time(cycle(0))), "{case}");
    }
}

#[test]
fn first_cycle_waits_for_the_response() {
    let mut adapter = open(ecan_sim::echo(1), raw_config().0).unwrap();
    adapter.activate().unwrap();
    let clock = adapter.ecrt().clock().clone();
    adapter.receive().unwrap();
    adapter.send().unwrap();
    let sent_ns = clock.now_ns();
    adapter.wait_next_cycle();
    assert!(adapter.response_ns() > 60_000);
    assert_eq!(clock.now_ns() - sent_ns, adapter.response_ns());
}

#[test]
fn changed_cycle_applies_after_the_next_activation() {
    let (config, _) = raw_config();
    let mut adapter = open(ecan_sim::echo(1), config).unwrap();
    adapter.wait_op(Duration::from_secs(10)).unwrap();
    let slower = config.with_cycle(Duration::from_millis(2));
    adapter.reconfigure(slower, StartupPlan::default()).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    let before = adapter.cycle_start().deadline_ns;
    adapter.wait_next_cycle();
    assert_eq!(adapter.cycle_start().deadline_ns - before, 2_000_000);
}

fn policies() -> impl Strategy<Value = OverrunPolicy> {
    let bounded = (0_u32..6).prop_map(|max_cycles| OverrunPolicy::CatchUp { max_cycles });
    prop_oneof![Just(OverrunPolicy::Skip), bounded]
}

proptest! {
    #[test]
    fn grid_never_drifts(
        overrun in policies(),
        spin_ns in 0_u64..200_000,
        cycle_ns in 100_000_u32..20_000_000,
        work in prop::collection::vec(0_u64..800, 1..60),
    ) {
        let ecrt = simulated(ecan_sim::echo(1)).0;
        let clock = ecrt.clock();
        let cycle = u64::from(cycle_ns);
        let mut timer = CycleTimer::new(cycle_ns, CycleTiming { spin_ns, overrun });
        let first = timer.wait(clock.as_ref()).deadline_ns;
        let mut points = 0;
        for percent in work {
            let before = clock.now_ns();
            let done = before + cycle * percent / 100;
            clock.sleep_until_ns(done);
            let start = timer.wait(clock.as_ref());
            points += 1 + start.skipped;
            prop_assert_eq!(start.deadline_ns, first + points * cycle);
            prop_assert_eq!(clock.now_ns(), start.begun_ns());
            prop_assert_eq!(start.begun_ns(), done.max(start.deadline_ns));
            let bound = match overrun {
                OverrunPolicy::Skip => 0,
                OverrunPolicy::CatchUp { max_cycles } => u64::from(max_cycles),
            };
            prop_assert!(start.late_ns < bound.max(1) * cycle);
            prop_assert!(bound > 0 || start.late_ns == 0);
            // A point in the span of the work, its end included, is an overrun, and nothing else.
            let passed = |time: u64| (time - first) / cycle;
            prop_assert_eq!(start.has_overrun, passed(done) > passed(before));
        }
    }
}
