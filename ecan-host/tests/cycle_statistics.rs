//! Histograms of the cycle: exact ends, bounded percentiles, the manual's line.

use std::time::Duration;

use ecan_host::{CycleStart, CycleStatistics, Distribution, StartupPlan};

const CYCLE_NS: u64 = 1_000_000;

fn record(statistics: &mut CycleStatistics, point: u64, late_ns: u64, run_ns: u64) {
    let start = CycleStart { deadline_ns: point * CYCLE_NS, late_ns, ..CycleStart::default() };
    statistics.begin(&start);
    statistics.end(start.begun_ns() + run_ns);
}

#[test]
fn empty_statistics_are_none() {
    let statistics = CycleStatistics::new(CYCLE_NS as u32);
    assert_eq!(statistics.period(), Distribution::default());
    let text =
        "master_period: none\nwake_up: none\nrun_time: none\ncycles 0, overruns 0, skipped 0";
    assert_eq!(statistics.to_string(), text);
}

#[test]
fn ends_and_mean_are_exact_and_percentiles_close() {
    let mut statistics = CycleStatistics::new(CYCLE_NS as u32);
    for nth in 0..=1000 {
        // Late by 71 ns once, which shortens the period after it.
        record(&mut statistics, nth, if nth == 500 { 71 } else { 0 }, 1_000 + nth);
    }
    let period = statistics.period();
    assert_eq!((period.count, period.min_ns, period.max_ns), (1000, 999_929, 1_000_071));
    assert_eq!(period.mean_ns, 1e6);
    for percentile in [period.p50_ns, period.p95_ns, period.p99_ns, period.p99_9_ns] {
        assert!(percentile.abs_diff(CYCLE_NS) <= 100, "{percentile}");
    }
    let run_time = statistics.run_time();
    assert_eq!((run_time.count, run_time.min_ns, run_time.max_ns), (1001, 1_000, 2_000));
    let expected = [(run_time.p50_ns, 1500), (run_time.p95_ns, 1950), (run_time.p99_ns, 1990)];
    for (percentile, exact) in expected {
        assert!(percentile.abs_diff(exact) <= 2, "{percentile} instead of {exact}");
    }
    assert_eq!(statistics.wake_up().p99_9_ns, 0);
    assert_eq!(statistics.wake_up().max_ns, 71);
    assert_eq!(statistics.max_period_error_ns(), 71);
    let line = statistics.to_string();
    assert!(
        line.starts_with("master_period: min/max 999.929/1000.071 us, mean 1000.000 us"),
        "{line}"
    );
    assert!(line.lines().next().unwrap().ends_with("max error 0.071 us"), "{line}");
}

#[test]
fn overruns_and_skipped_deadlines_are_summed() {
    let mut statistics = CycleStatistics::new(CYCLE_NS as u32);
    let late = CycleStart { deadline_ns: 6 * CYCLE_NS, skipped: 5, has_overrun: true, late_ns: 0 };
    statistics.begin(&CycleStart { deadline_ns: 0, ..late });
    assert_eq!((statistics.overruns(), statistics.skipped()), (0, 0), "those were before");
    statistics.begin(&late);
    assert_eq!((statistics.cycles(), statistics.overruns(), statistics.skipped()), (2, 1, 5));
    assert_eq!(statistics.period().max_ns, 6 * CYCLE_NS);
    assert_eq!(statistics.max_period_error_ns(), 5 * CYCLE_NS);
    statistics.clear();
    assert_eq!(statistics.to_string(), CycleStatistics::new(CYCLE_NS as u32).to_string());
}

#[test]
fn paused_cycles_are_no_period_and_not_missed() {
    let mut statistics = CycleStatistics::new(CYCLE_NS as u32);
    record(&mut statistics, 0, 0, 1_000);
    statistics.pause();
    let start = CycleStart { deadline_ns: 9 * CYCLE_NS, skipped: 5, has_overrun: true, late_ns: 0 };
    statistics.begin(&start);
    record(&mut statistics, 10, 0, 1_000);
    assert_eq!((statistics.cycles(), statistics.overruns(), statistics.skipped()), (3, 0, 0));
    assert_eq!((statistics.period().count, statistics.period().max_ns), (1, CYCLE_NS));
}

#[test]
fn times_out_of_range_are_recorded_at_the_limit() {
    let mut statistics = CycleStatistics::new(CYCLE_NS as u32);
    statistics.end(7);
    assert_eq!(statistics.run_time().count, 0, "no cycle has begun");
    record(&mut statistics, 0, u64::MAX / 2, 0);
    record(&mut statistics, 0, 0, u64::MAX);
    assert_eq!(statistics.wake_up().max_ns, u64::MAX / 2);
    assert_eq!(statistics.wake_up().count, 2);
    assert_eq!(statistics.run_time().max_ns, u64::MAX);
    assert!(statistics.run_time().p99_ns >= 1_000_000_000);
}

#[test]
fn percentiles_of_a_list_are_nearest_ranks() {
    let times: Vec<u64> = (1..=200).rev().collect();
    let of = Distribution::of(&times);
    assert_eq!((of.count, of.min_ns, of.max_ns), (200, 1, 200));
    assert!((of.mean_ns - 100.5).abs() < 1e-9);
    assert_eq!((of.p50_ns, of.p95_ns, of.p99_ns, of.p99_9_ns), (100, 190, 198, 200));
    assert_eq!(Distribution::of(&[]), Distribution::default());
    let single = Distribution::of(&[7]);
    assert_eq!((single.p50_ns, single.p99_9_ns), (7, 7));
}

#[test]
fn adapter_restarts_its_statistics_after_a_reconfiguration() {
    let (mut config, _) = crate::common::raw_config();
    let mut adapter = crate::common::open(ecan_sim::echo(1), config).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    assert!(adapter.cycle_statistics().is_none());
    adapter.measure_cycles();
    crate::common::run(&mut adapter, 101);
    let measured = adapter.cycle_statistics().unwrap();
    assert_eq!((measured.cycles(), measured.period().count), (101, 100));
    assert_eq!((measured.run_time().count, measured.max_period_error_ns()), (101, 0));
    config.cycle = Duration::from_millis(2);
    adapter.reconfigure(config, StartupPlan::default()).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    let measured = adapter.cycle_statistics().unwrap();
    assert_eq!((measured.period().min_ns, measured.max_period_error_ns()), (2_000_000, 0));
}
