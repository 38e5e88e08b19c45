//! No allocation in waiting for cycles and recording them.

use crate::common::{open, raw_config};
use ecan_host::{Clock, CycleStatistics, CycleTimer, CycleTiming, MonotonicClock, OverrunPolicy};
use ecan_test_support::allocations;

#[test]
fn wait_and_recording_do_not_allocate() {
    let mut adapter = open(ecan_sim::echo(1), raw_config().0).unwrap();
    let clock = adapter.ecrt().clock().clone();
    let mut statistics = CycleStatistics::new(1_000_000);
    let policies = [OverrunPolicy::Skip, OverrunPolicy::CatchUp { max_cycles: 3 }];
    // The simulated world comes to rest first.
    clock.sleep_until_ns(clock.now_ns() + 1_000_000_000);
    for overrun in policies {
        adapter.set_cycle_timing(CycleTiming { spin_ns: 100_000, overrun });
        let before = allocations();
        for nth in 0..2_000 {
            adapter.wait_next_cycle();
            statistics.begin(&adapter.cycle_start());
            clock.sleep_until_ns(clock.now_ns() + nth % 7 * 400_000);
            statistics.end(clock.now_ns());
        }
        assert_eq!(allocations() - before, 0, "{overrun:?}");
    }
    assert!(statistics.overruns() > 0 && statistics.skipped() > 0);
    assert_eq!(statistics.cycles(), 4_000);
    let before = allocations();
    statistics.clear();
    assert_eq!(allocations() - before, 0);
}

#[test]
fn spin_on_the_system_clock_does_not_allocate() {
    let clock = MonotonicClock;
    let timing = CycleTiming { spin_ns: 50_000, ..CycleTiming::default() };
    let mut timer = CycleTimer::new(100_000, timing);
    let mut statistics = CycleStatistics::new(100_000);
    let before = allocations();
    for _ in 0..100 {
        statistics.begin(&timer.wait(&clock));
        statistics.end(clock.now_ns());
    }
    assert_eq!(allocations() - before, 0);
}
