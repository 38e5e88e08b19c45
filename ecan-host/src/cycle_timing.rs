//! The deadlines of the cycle: the timer that waits for them, and statistics of the cycles (manual 13.9).

use std::fmt;

use ecrt_sys::Clock;
use hdrhistogram::Histogram;

/// Longest final spin of a configuration, in nanoseconds; a longer one only wastes processor time.
pub const MAX_SPIN_NS: u64 = 1_000_000;

/// Treatment of deadlines that passed during a cycle that took too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OverrunPolicy {
    /// Missed deadlines are skipped; the next cycle starts at the next deadline.
    #[default]
    Skip,
    /// Their cycles are executed one after the other, each with its own deadline: for applications
    /// that count cycles. An [`Adapter`](crate::Adapter) waits for the response of the bus between
    /// two of them, so that it catches up only if work and response together take less than a
    /// cycle; a timer alone does not wait.
    CatchUp {
        /// Largest number of cycles to catch up; older ones are skipped. 0 is as `Skip`.
        max_cycles: u32,
    },
}

/// Timing of the wait for the next cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleTiming {
    /// Time before each deadline in which the clock is polled instead of slept on, in nanoseconds,
    /// 0 to [`MAX_SPIN_NS`] (manual 13.9: 100 us). It removes the wake-up delay from the cycle and
    /// costs as much processor time. On a stepped clock the spin is simulated: it absorbs simulated
    /// delays and costs nothing.
    pub spin_ns: u64,
    /// Treatment of missed deadlines.
    pub overrun: OverrunPolicy,
}

/// A cycle that is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleStart {
    /// Deadline of the cycle, in nanoseconds of the clock.
    pub deadline_ns: u64,
    /// Delay of the end of the wait after the deadline, in nanoseconds: the wake-up error, and for a
    /// cycle that catches up its whole delay.
    pub late_ns: u64,
    /// Deadlines skipped before this one.
    pub skipped: u64,
    /// The previous cycle, with the response of the bus, missed a deadline. Deadlines of cycles that
    /// catch up do not count again; one that passes during the wait for the response does.
    pub has_overrun: bool,
}

impl CycleStart {
    /// When the wait ended, in nanoseconds of the clock.
    pub fn begun_ns(&self) -> u64 {
        self.deadline_ns.saturating_add(self.late_ns)
    }
}

/// Waits for the deadlines of a grid of equal cycles, one after the other.
///
/// The deadlines are absolute, fixed by the first wait, so that neither run time nor wake-up delays
/// accumulate. [`Adapter::wait_next_cycle`](crate::Adapter::wait_next_cycle) uses one; a separate
/// timer is for applications whose cycle is not the Adapter's.
///
/// Belongs to one thread at a time. Never allocates.
///
/// ```
/// use ecan_host::{Clock, CycleTimer, CycleTiming, MonotonicClock};
///
/// let clock = MonotonicClock;
/// let mut timer = CycleTimer::new(1_000_000, CycleTiming::default());
/// let first = timer.wait(&clock);
/// let second = timer.wait(&clock);
/// assert_eq!((second.deadline_ns - first.deadline_ns) % 1_000_000, 0);
/// assert!(clock.now_ns() >= second.deadline_ns);
/// ```
#[derive(Debug, Clone)]
pub struct CycleTimer {
    cycle_ns: u64,
    timing: CycleTiming,
    /// The last deadline; `None` before the first.
    last_ns: Option<u64>,
    /// Deadlines after it that had passed already.
    passed: u64,
}

impl CycleTimer {
    /// A timer whose grid starts with the first [`wait`](Self::wait). The cycle is in nanoseconds;
    /// 0 is taken for 1. A spin of more than [`MAX_SPIN_NS`] is cut to that.
    pub fn new(cycle_ns: u32, timing: CycleTiming) -> Self {
        let mut timer =
            Self { cycle_ns: 1, timing: CycleTiming::default(), last_ns: None, passed: 0 };
        timer.set_cycle_ns(cycle_ns);
        timer.set_timing(timing);
        timer
    }

    /// Changes spin and overrun policy from the next wait on; the grid stays. Real-time safe.
    pub fn set_timing(&mut self, timing: CycleTiming) {
        self.timing = CycleTiming { spin_ns: timing.spin_ns.min(MAX_SPIN_NS), ..timing };
    }

    /// Spin and overrun policy in force. Real-time safe.
    pub fn timing(&self) -> CycleTiming {
        self.timing
    }

    /// Length of the cycle in nanoseconds. Real-time safe.
    pub fn cycle_ns(&self) -> u64 {
        self.cycle_ns
    }

    /// Changes the cycle; its grid continues from the last deadline. In nanoseconds; 0 counts as 1.
    pub(crate) fn set_cycle_ns(&mut self, cycle_ns: u32) {
        self.cycle_ns = u64::from(cycle_ns.max(1));
    }

    /// Moves the rest of the grid by this time. Real-time safe.
    pub fn shift(&mut self, by_ns: i64) {
        self.last_ns = self.last_ns.map(|last| last.saturating_add_signed(by_ns));
    }

    /// Forgets the grid: the next wait starts another, at once. Real-time safe.
    pub fn restart(&mut self) {
        self.last_ns = None;
        self.passed = 0;
    }

    /// The next point of the grid; `None` before the first wait. Real-time safe.
    pub(crate) fn next_deadline_ns(&self) -> Option<u64> {
        self.last_ns.map(|last| last.saturating_add(self.cycle_ns))
    }

    /// Waits for the next point of the grid; the first call starts the grid and returns at once.
    ///
    /// Sleeps, and spins before the end where that is set. Real-time safe: no allocation, no lock,
    /// no system call but the clock's own sleep. `clock` is the same in every call.
    pub fn wait(&mut self, clock: &dyn Clock) -> CycleStart {
        let start = self.begin_wait(clock.now_ns(), 0).sleep(clock);
        self.end_wait(&start);
        start
    }

    /// Determines the next point of the grid. The wait does not end before `earliest_ns`: a cycle
    /// lasts until its response is back, and with that it may take past a point.
    pub(crate) fn begin_wait(&mut self, now_ns: u64, earliest_ns: u64) -> TimerWait {
        let now_ns = now_ns.max(earliest_ns);
        let Some(last) = self.last_ns else {
            return TimerWait {
                deadline_ns: None,
                until_ns: now_ns,
                spin_ns: 0,
                skipped: 0,
                has_overrun: false,
            };
        };
        let missed = now_ns.saturating_sub(last) / self.cycle_ns;
        let made_up_for = match self.timing.overrun {
            OverrunPolicy::Skip => 0,
            OverrunPolicy::CatchUp { max_cycles } => missed.min(u64::from(max_cycles)),
        };
        let skipped = missed - made_up_for;
        let has_overrun = missed > self.passed;
        let deadline_ns = last + (skipped + 1) * self.cycle_ns;
        self.last_ns = Some(deadline_ns);
        self.passed = made_up_for.saturating_sub(1);
        TimerWait {
            deadline_ns: Some(deadline_ns),
            until_ns: deadline_ns.max(earliest_ns),
            spin_ns: self.timing.spin_ns,
            skipped,
            has_overrun,
        }
    }

    /// Starts the grid at the first cycle.
    pub(crate) fn end_wait(&mut self, start: &CycleStart) {
        self.last_ns.get_or_insert(start.deadline_ns);
    }
}

/// A wait for the next point of the grid, which does not need the timer.
#[derive(Debug)]
pub(crate) struct TimerWait {
    /// `None` for the first point, which is where the wait ends.
    deadline_ns: Option<u64>,
    until_ns: u64,
    spin_ns: u64,
    skipped: u64,
    has_overrun: bool,
}

impl TimerWait {
    pub(crate) fn sleep(&self, clock: &dyn Clock) -> CycleStart {
        clock.sleep_and_spin_until_ns(self.until_ns, self.spin_ns);
        let now_ns = clock.now_ns();
        let deadline_ns = self.deadline_ns.unwrap_or(now_ns);
        CycleStart {
            deadline_ns,
            late_ns: now_ns.saturating_sub(deadline_ns),
            skipped: self.skipped,
            has_overrun: self.has_overrun,
        }
    }
}

/// Longest time that the percentiles resolve, in nanoseconds: ten of the longest cycles that an
/// Adapter takes.
const LONGEST_NS: u64 = 1_000_000_000;

/// A row of times, in nanoseconds. All 0 where nothing was recorded.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distribution {
    /// Number of times recorded.
    pub count: u64,
    /// Shortest, exact.
    pub min_ns: u64,
    /// Longest, exact.
    pub max_ns: u64,
    /// Mean, exact.
    pub mean_ns: f64,
    /// Half of the times are at most this long. As all percentiles of [`CycleStatistics`] to within
    /// 0.1 %, of periods 0.01 %, and up to 1 s; those of [`of`](Self::of) are exact.
    pub p50_ns: u64,
    /// 95 of 100 are at most this long.
    pub p95_ns: u64,
    /// 99 of 100 are at most this long.
    pub p99_ns: u64,
    /// 999 of 1000 are at most this long.
    pub p99_9_ns: u64,
}

impl Distribution {
    /// The distribution of a list of times, in any order, with exact percentiles: the smallest time
    /// that this share of them does not exceed. Allocates and sorts; not for the cycle.
    ///
    /// ```
    /// let times = ecan_host::Distribution::of(&[30, 10, 20]);
    /// assert_eq!((times.min_ns, times.p50_ns, times.max_ns), (10, 20, 30));
    /// ```
    pub fn of(times_ns: &[u64]) -> Self {
        let mut sorted = times_ns.to_vec();
        sorted.sort_unstable();
        let (Some(min_ns), Some(max_ns)) = (sorted.first(), sorted.last()) else {
            return Self::default();
        };
        let at = |permille: usize| {
            let rank = (sorted.len() * permille).div_ceil(1_000);
            sorted.get(rank.saturating_sub(1)).copied().unwrap_or(*max_ns)
        };
        let sum_ns: u128 = sorted.iter().copied().map(u128::from).sum();
        Self {
            count: sorted.len() as u64,
            min_ns: *min_ns,
            max_ns: *max_ns,
            mean_ns: sum_ns as f64 / sorted.len() as f64,
            p50_ns: at(500),
            p95_ns: at(950),
            p99_ns: at(990),
            p99_9_ns: at(999),
        }
    }
}

impl fmt::Display for Distribution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.count == 0 {
            return f.write_str("none");
        }
        let us = |ns: u64| ns as f64 / 1e3;
        let (min, max, mean) = (us(self.min_ns), us(self.max_ns), self.mean_ns / 1e3);
        let (p50, p95) = (us(self.p50_ns), us(self.p95_ns));
        let (p99, p99_9) = (us(self.p99_ns), us(self.p99_9_ns));
        write!(f, "min/max {min:.3}/{max:.3} us, mean {mean:.3} us, p50 {p50:.3} us, ")?;
        write!(f, "p95 {p95:.3} us, p99 {p99:.3} us, p99.9 {p99_9:.3} us")
    }
}

/// A histogram with exact ends and mean, which its steps would blur.
#[derive(Debug, Clone)]
struct Times {
    histogram: Histogram<u64>,
    min_ns: u64,
    max_ns: u64,
    sum_ns: u64,
}

impl Times {
    fn new(digits: u8) -> Self {
        let histogram = Histogram::new_with_bounds(1, LONGEST_NS, digits);
        let mut histogram = histogram.expect("the bounds are constants that it takes");
        // Written to, the memory is really there: no page fault in the cycle.
        histogram.clear();
        Self { histogram, min_ns: u64::MAX, max_ns: 0, sum_ns: 0 }
    }

    fn record(&mut self, ns: u64) {
        self.histogram.saturating_record(ns);
        self.min_ns = self.min_ns.min(ns);
        self.max_ns = self.max_ns.max(ns);
        self.sum_ns = self.sum_ns.saturating_add(ns);
    }

    fn clear(&mut self) {
        self.histogram.clear();
        (self.min_ns, self.max_ns, self.sum_ns) = (u64::MAX, 0, 0);
    }

    fn distribution(&self) -> Distribution {
        let count = self.histogram.len();
        if count == 0 {
            return Distribution::default();
        }
        let at =
            |quantile| self.histogram.value_at_quantile(quantile).clamp(self.min_ns, self.max_ns);
        Distribution {
            count,
            min_ns: self.min_ns,
            max_ns: self.max_ns,
            mean_ns: self.sum_ns as f64 / count as f64,
            p50_ns: at(0.5),
            p95_ns: at(0.95),
            p99_ns: at(0.99),
            p99_9_ns: at(0.999),
        }
    }
}

/// Periods, delays and run times of the cycle, and what was missed (manual 13.9).
///
/// All memory, about 3 MB, is taken and touched by [`new`](Self::new); recording allocates
/// nothing. Belongs to one thread at a time.
///
/// ```
/// use ecan_host::{Clock, CycleStatistics, CycleTimer, CycleTiming, MonotonicClock};
///
/// let clock = MonotonicClock;
/// let mut timer = CycleTimer::new(200_000, CycleTiming::default());
/// let mut statistics = CycleStatistics::new(200_000);
/// for _ in 0..5 {
///     statistics.begin(&timer.wait(&clock));
///     // The work of the cycle.
///     statistics.end(clock.now_ns());
/// }
/// println!("{statistics}");
/// assert_eq!(statistics.period().count, 4);
/// ```
#[derive(Debug, Clone)]
pub struct CycleStatistics {
    cycle_ns: u64,
    period: Times,
    wake_up: Times,
    run_time: Times,
    begun_ns: Option<u64>,
    cycles: u64,
    overruns: u64,
    skipped: u64,
}

impl CycleStatistics {
    /// Empty statistics of a cycle that is meant to take `cycle_ns` nanoseconds. Takes its memory
    /// here, so not for the cycle.
    pub fn new(cycle_ns: u32) -> Self {
        Self {
            cycle_ns: u64::from(cycle_ns),
            // Of a period the last digits matter: 0.1 us of a millisecond.
            period: Times::new(4),
            wake_up: Times::new(3),
            run_time: Times::new(3),
            begun_ns: None,
            cycles: 0,
            overruns: 0,
            skipped: 0,
        }
    }

    /// Notes the start of a cycle, right after the wait for it. What was missed before the first
    /// one noted is not counted. Real-time safe.
    pub fn begin(&mut self, start: &CycleStart) {
        let begun = start.begun_ns();
        if let Some(before) = self.begun_ns.replace(begun) {
            self.period.record(begun.saturating_sub(before));
            self.overruns += u64::from(start.has_overrun);
            self.skipped += start.skipped;
        }
        self.wake_up.record(start.late_ns);
        self.cycles += 1;
    }

    /// Notes the end of a cycle's work: the clock's time in nanoseconds. Before the first
    /// [`begin`](Self::begin) it notes nothing. Real-time safe.
    pub fn end(&mut self, now_ns: u64) {
        if let Some(begun) = self.begun_ns {
            self.run_time.record(now_ns.saturating_sub(begun));
        }
    }

    /// Leaves out the cycles from here to the next [`begin`](Self::begin), whatever they were: the
    /// time between is no period, and what was missed in it is not counted. Real-time safe.
    pub fn pause(&mut self) {
        self.begun_ns = None;
    }

    /// Starts anew, as after a phase of settling. The first period is counted from the next
    /// start on. Writes all histograms, so not for the cycle; allocates nothing.
    pub fn clear(&mut self) {
        for times in [&mut self.period, &mut self.wake_up, &mut self.run_time] {
            times.clear();
        }
        self.begun_ns = None;
        (self.cycles, self.overruns, self.skipped) = (0, 0, 0);
    }

    /// From the start of a cycle to the next: `master_period`. Not for the cycle, as all
    /// distributions.
    pub fn period(&self) -> Distribution {
        self.period.distribution()
    }

    /// From the point on the grid to the start of its cycle.
    pub fn wake_up(&self) -> Distribution {
        self.wake_up.distribution()
    }

    /// From the start of a cycle to the end of its work.
    pub fn run_time(&self) -> Distribution {
        self.run_time.distribution()
    }

    /// Largest difference of a period from the cycle, in nanoseconds; 0 before the second cycle.
    pub fn max_period_error_ns(&self) -> u64 {
        let period = self.period();
        let error = |ns: u64| ns.abs_diff(self.cycle_ns);
        if period.count == 0 { 0 } else { error(period.min_ns).max(error(period.max_ns)) }
    }

    /// Cycles started. Real-time safe.
    pub fn cycles(&self) -> u64 {
        self.cycles
    }

    /// Cycles that took past a point of the grid, with the answer of the bus. Real-time safe.
    pub fn overruns(&self) -> u64 {
        self.overruns
    }

    /// Points of the grid that were left out. Real-time safe.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }
}

impl fmt::Display for CycleStatistics {
    /// The `master_period` line of manual 13.9 and what belongs to it, without a final line feed.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "master_period: {}", self.period())?;
        if self.cycles > 1 {
            write!(f, ", max error {:.3} us", self.max_period_error_ns() as f64 / 1e3)?;
        }
        writeln!(f, "\nwake_up: {}", self.wake_up())?;
        writeln!(f, "run_time: {}", self.run_time())?;
        let (cycles, overruns, skipped) = (self.cycles, self.overruns, self.skipped);
        write!(f, "cycles {cycles}, overruns {overruns}, skipped {skipped}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn next_deadline_is_a_cycle_after_the_last_one() {
        let mut timer = CycleTimer::new(1_000, CycleTiming::default());
        assert_eq!(timer.next_deadline_ns(), None);
        let (deadline_ns, late_ns, skipped, has_overrun) = (50_000, 0, 0, false);
        timer.end_wait(&CycleStart { deadline_ns, late_ns, skipped, has_overrun });
        assert_eq!(timer.next_deadline_ns(), Some(51_000));
        timer.shift(-20);
        assert_eq!(timer.next_deadline_ns(), Some(50_980));
    }
}
