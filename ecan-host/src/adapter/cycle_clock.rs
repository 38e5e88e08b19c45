//! The grid of cycle deadlines, shared by waiting calls, the application and the clocks.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use ecrt_sys::Clock;
use tracing::{info, warn};

use crate::cycle_timing::{CycleStart, CycleStatistics, CycleTimer, CycleTiming, TimerWait};
use crate::observer::CycleRecord;

/// A wait for the next deadline, from [`Adapter::begin_wait`](crate::Adapter::begin_wait). It borrows nothing.
#[must_use = "the cycle starts after the sleep"]
pub struct CycleWait {
    timer: TimerWait,
    clock: Arc<dyn Clock>,
}

impl CycleWait {
    /// Sleeps until the deadline, with the final spin of [`Adapter::set_cycle_timing`](crate::Adapter::set_cycle_timing). Real-time
    /// safe.
    pub fn sleep(self) -> CycleStart {
        self.timer.sleep(self.clock.as_ref())
    }
}

impl fmt::Debug for CycleWait {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CycleWait").field("timer", &self.timer).finish_non_exhaustive()
    }
}

/// The times of the cycle: its grid, its start, its end, and the cycles that were counted.
pub(super) struct CycleClock {
    clock: Arc<dyn Clock>,
    timer: CycleTimer,
    start: CycleStart,
    statistics: Option<CycleStatistics>,
    overruns: Overruns,
    /// Deadline of the cycle that begins next, after a wait.
    due_ns: Option<u64>,
    /// Time of the running cycle on the grid.
    time_ns: u64,
    sent_ns: u64,
    /// Time that the response of the bus may take.
    response_ns: u64,
    correction_ns: i64,
    counts: CycleCounts,
}

/// Counters of the cycle since the Adapter was opened.
#[derive(Debug, Clone, Copy, Default)]
struct CycleCounts {
    cycles: u64,
    overruns: u64,
    skipped: u64,
    /// The running cycle began with a wait.
    has_start: bool,
}

impl fmt::Debug for CycleClock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { timer, time_ns, counts, .. } = self;
        let mut fields = f.debug_struct("CycleClock");
        fields.field("timer", timer).field("time_ns", time_ns).field("counts", counts);
        fields.finish_non_exhaustive()
    }
}

impl CycleClock {
    pub(super) fn new(clock: Arc<dyn Clock>, cycle_ns: u32) -> Self {
        Self {
            clock,
            timer: CycleTimer::new(cycle_ns, CycleTiming::default()),
            start: CycleStart::default(),
            statistics: None,
            overruns: Overruns::default(),
            due_ns: None,
            time_ns: 0,
            sent_ns: 0,
            response_ns: 0,
            correction_ns: 0,
            counts: CycleCounts::default(),
        }
    }

    /// Sets another cycle, and restarts the statistics.
    pub(super) fn set_cycle_ns(&mut self, cycle_ns: u32) {
        self.timer.set_cycle_ns(cycle_ns);
        if self.statistics.is_some() {
            self.measure(cycle_ns);
        }
    }

    pub(super) fn set_timing(&mut self, timing: CycleTiming) {
        self.timer.set_timing(timing);
    }

    pub(super) fn set_response_ns(&mut self, response_ns: u64) {
        self.response_ns = response_ns;
    }

    /// Lets the grid start with the next cycle.
    pub(super) fn restart(&mut self) {
        self.timer.restart();
    }

    pub(super) fn begin_wait(&mut self) -> CycleWait {
        let timer = self.timer.begin_wait(self.clock.now_ns(), self.answered_ns());
        CycleWait { timer, clock: self.clock.clone() }
    }

    pub(super) fn end_wait(&mut self, start: CycleStart) {
        self.timer.end_wait(&start);
        self.start = start;
        self.due_ns = Some(start.deadline_ns);
        self.overruns.update(start.skipped);
        if let Some(statistics) = &mut self.statistics {
            statistics.begin(&start);
        }
    }

    pub(super) fn measure(&mut self, cycle_ns: u32) {
        self.statistics = Some(CycleStatistics::new(cycle_ns));
    }

    /// Fixes the time of the cycle that starts now, and returns it. `is_counted`: the cycle belongs to
    /// the application.
    #[inline]
    pub(super) fn start_cycle(&mut self, is_counted: bool) -> u64 {
        let due_ns = self.due_ns.take();
        if is_counted {
            let counts = &mut self.counts;
            counts.cycles += 1;
            counts.has_start = due_ns.is_some();
            if counts.has_start {
                counts.overruns += u64::from(self.start.has_overrun);
                counts.skipped += self.start.skipped;
            }
        }
        self.time_ns = due_ns.unwrap_or_else(|| self.clock.now_ns());
        self.time_ns
    }

    /// The work of the cycle is done.
    #[inline]
    pub(super) fn end_cycle(&mut self) {
        self.sent_ns = self.clock.now_ns();
        if let Some(statistics) = &mut self.statistics {
            statistics.end(self.sent_ns);
        }
    }

    /// Shifts the next deadline.
    #[inline]
    pub(super) fn correct_deadline(&mut self, by_ns: i64) {
        self.correction_ns = by_ns;
        self.timer.shift(by_ns);
    }

    #[inline]
    pub(super) fn clear_correction(&mut self) {
        self.correction_ns = 0;
    }

    /// The cycle for observers, without their commands.
    #[inline]
    pub(super) fn record(&self) -> CycleRecord {
        let CycleCounts { cycles, overruns, skipped, has_start } = self.counts;
        let start = has_start.then_some(self.start);
        let begun_ns = start.map_or(self.time_ns, |start| start.begun_ns());
        CycleRecord {
            cycle: cycles,
            time_ns: self.time_ns,
            start,
            run_time_ns: self.sent_ns.saturating_sub(begun_ns),
            overruns,
            skipped,
            ..CycleRecord::default()
        }
    }

    pub(super) fn start(&self) -> CycleStart {
        self.start
    }

    pub(super) fn statistics(&self) -> Option<&CycleStatistics> {
        self.statistics.as_ref()
    }

    pub(super) fn cycle_number(&self) -> u64 {
        self.counts.cycles
    }

    pub(super) fn time_ns(&self) -> u64 {
        self.time_ns
    }

    pub(super) fn response_ns(&self) -> u64 {
        self.response_ns
    }

    pub(super) fn correction_ns(&self) -> i64 {
        self.correction_ns
    }

    /// Time at which the response to the last send has arrived.
    pub(super) fn answered_ns(&self) -> u64 {
        self.sent_ns.saturating_add(self.response_ns)
    }

    pub(super) fn next_deadline_ns(&self) -> Option<u64> {
        self.timer.next_deadline_ns()
    }
}

/// Consecutive cycles that started after a missed deadline.
#[derive(Debug, Clone, Copy, Default)]
struct Overruns {
    cycles: u64,
    skipped: u64,
}

impl Overruns {
    /// Counts a cycle, and logs the first and the last overrun.
    fn update(&mut self, skipped: u64) {
        if skipped > 0 {
            if self.cycles == 0 {
                warn!(skipped, "cycle: overrun ({skipped} deadlines skipped)");
            }
            self.cycles += 1;
            self.skipped += skipped;
        } else if self.cycles > 0 {
            let Self { cycles, skipped } = std::mem::take(self);
            info!(cycles, skipped, "cycle: in time again ({skipped} deadlines skipped)");
        }
    }
}

/// The time `timeout` from now on `clock`, in nanoseconds.
pub(super) fn deadline_ns(clock: &dyn Clock, timeout: Duration) -> u64 {
    let timeout_ns = u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX);
    clock.now_ns().saturating_add(timeout_ns)
}
