//! Times of the cycle: measured in each cycle, or sampled by a service.

use ecan_host::{CycleStatistics, Distribution};
use ecan_service::protocol::{CycleState, SampledTimes};

use super::observation::{Layout, Observation, SampledCycle};
use super::snapshot::{CLASSES, CycleView, Times};

#[derive(Debug)]
pub struct CycleTimes {
    cycle_ns: u32,
    cycles: CycleStatistics,
    histogram: [u64; CLASSES],
    unmeasured: u64,
    last_begin_ns: Option<u64>,
    sampled: Option<SampledCycle>,
    /// Counters of the sampled cycle at the last clear.
    base: CycleState,
}

impl CycleTimes {
    pub fn new(layout: &Layout) -> Self {
        Self {
            cycle_ns: layout.cycle_ns,
            cycles: CycleStatistics::new(layout.cycle_ns),
            histogram: [0; CLASSES],
            unmeasured: 0,
            last_begin_ns: None,
            sampled: None,
            base: layout.base,
        }
    }

    pub fn clear(&mut self) {
        self.cycles.clear();
        self.histogram = [0; CLASSES];
        (self.unmeasured, self.last_begin_ns) = (0, None);
        self.base = self.sampled.as_ref().map_or(self.base, |sampled| sampled.cycle);
    }

    pub fn take(&mut self, observation: &Observation) {
        if observation.sampled.is_some() {
            self.sampled.clone_from(&observation.sampled);
        }
        for mark in &observation.marks {
            self.cycles.begin(&mark.start);
            self.cycles.end(mark.end_ns);
            let begin_ns = mark.start.begun_ns();
            if let Some(before_ns) = self.last_begin_ns.replace(begin_ns) {
                let class = class(begin_ns.saturating_sub(before_ns), self.cycle_ns);
                if let Some(count) = self.histogram.get_mut(class) {
                    *count += 1;
                }
            }
        }
        self.unmeasured += observation.unmeasured;
        if observation.unmeasured > 0 {
            // Unmeasured cycles came after the marks: the next mark starts a new period.
            self.cycles.pause();
            self.last_begin_ns = None;
        }
    }

    pub fn view(&self) -> CycleView {
        let cycle_us = f64::from(self.cycle_ns) / 1e3;
        match &self.sampled {
            Some(SampledCycle { cycle, run_time, late }) => CycleView {
                cycle_us,
                cycles: cycle.cycle.saturating_sub(self.base.cycle),
                overruns: cycle.overruns.saturating_sub(self.base.overruns),
                skipped: cycle.skipped.saturating_sub(self.base.skipped),
                sampled: Some(run_time.samples),
                run_time: sampled_times(run_time),
                late: Some(sampled_times(late)),
                ..CycleView::default()
            },
            None => CycleView {
                cycle_us,
                cycles: self.cycles.cycles(),
                overruns: self.cycles.overruns(),
                skipped: self.cycles.skipped(),
                unmeasured: self.unmeasured,
                period: Some(times(&self.cycles.period())),
                run_time: times(&self.cycles.run_time()),
                histogram: Some(self.histogram),
                ..CycleView::default()
            },
        }
    }
}

fn class(period_ns: u64, cycle_ns: u32) -> usize {
    let difference_ns = period_ns as i64 - i64::from(cycle_ns);
    let ends_ns = [-100_000, -10_000, -1_000, 1_001, 10_001, 100_001];
    ends_ns.iter().take_while(|end| difference_ns >= **end).count()
}

fn us(ns: u64) -> f64 {
    ns as f64 / 1e3
}

fn times(of: &Distribution) -> Times {
    Times {
        min_us: us(of.min_ns),
        p50_us: us(of.p50_ns),
        p95_us: Some(us(of.p95_ns)),
        p99_us: us(of.p99_ns),
        p99_9_us: Some(us(of.p99_9_ns)),
        max_us: us(of.max_ns),
    }
}

fn sampled_times(of: &SampledTimes) -> Times {
    Times {
        min_us: us(of.min_ns),
        p50_us: us(of.p50_ns),
        p95_us: None,
        p99_us: us(of.p99_ns),
        p99_9_us: None,
        max_us: us(of.max_ns),
    }
}

#[cfg(test)]
mod tests {
    use ecan_host::CycleStart;

    use super::super::observation::Mark;
    use super::*;

    #[test]
    fn periods_are_classified() {
        let table = [
            (0, 0),
            (899_999, 0),
            (900_000, 1),
            (990_000, 2),
            (999_000, 3),
            (1_000_000, 3),
            (1_001_000, 3),
            (1_001_001, 4),
            (1_010_001, 5),
            (1_100_000, 5),
            (1_100_001, 6),
        ];
        for (period_ns, expected) in table {
            assert_eq!(class(period_ns, 1_000_000), expected, "{period_ns}");
        }
    }

    #[test]
    fn gap_of_unmeasured_cycles_is_not_a_period() {
        let layout = Layout { cycle_ns: 1_000_000, ..Layout::default() };
        let mut times = CycleTimes::new(&layout);
        let mut observe = |starts_ns: [u64; 2], unmeasured| {
            let mut observation = Observation::new(1);
            for start_ns in starts_ns {
                let start =
                    CycleStart { deadline_ns: start_ns, late_ns: 0, skipped: 1, has_overrun: true };
                observation.mark(Mark { start, end_ns: start_ns + 200_000 });
            }
            observation.unmeasured = unmeasured;
            times.take(&observation);
            times.view()
        };
        observe([1_000_000, 2_000_000], 3);
        // Five milliseconds after the last measured one.
        let cycle = observe([7_000_000, 8_000_000], 0);
        assert_eq!((cycle.cycles, cycle.unmeasured), (4, 3));
        assert_eq!(cycle.histogram.unwrap(), [0, 0, 0, 2, 0, 0, 0]);
        let period = cycle.period.unwrap();
        assert_eq!((period.min_us, period.max_us), (1000.0, 1000.0));
        assert_eq!((cycle.overruns, cycle.skipped), (2, 2));
        let cycle = observe([9_000_000, 10_000_000], 0);
        assert_eq!(cycle.histogram.unwrap(), [0, 0, 0, 4, 0, 0, 0]);
    }
    #[test]
    fn sampled_cycle_has_no_periods_and_counts_from_the_clear() {
        let cycle = |cycle, overruns| CycleState { cycle, overruns, ..CycleState::default() };
        let base = cycle(1000, 2);
        let layout = Layout { cycle_ns: 500_000, base, ..Layout::default() };
        let mut times = CycleTimes::new(&layout);
        let run_time = SampledTimes { samples: 7, p50_ns: 1500, ..SampledTimes::default() };
        let mut view = |state, is_cleared| {
            let run_time = run_time.clone();
            let sampled = SampledCycle { cycle: state, run_time, late: SampledTimes::default() };
            let sampled = Some(sampled);
            times.take(&Observation { sampled, ..Observation::default() });
            if is_cleared {
                times.clear();
            }
            times.view()
        };
        let shown = view(cycle(1010, 3), false);
        assert_eq!((shown.cycles, shown.overruns, shown.sampled), (10, 1, Some(7)));
        assert_eq!((shown.period, shown.histogram), (None, None));
        assert_eq!((shown.run_time.p50_us, shown.run_time.p95_us), (1.5, None));
        assert_eq!(view(cycle(1020, 4), true).cycles, 0);
        assert_eq!(view(cycle(1025, 4), false).cycles, 5);
    }
}
