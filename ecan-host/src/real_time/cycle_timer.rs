//! The timer that waits for the deadlines of the cycle.

use ecrt_sys::Clock;

/// Longest final spin of a configuration, in nanoseconds; a longer one only wastes processor time.
pub const MAX_SPIN_NS: u64 = 1_000_000;

/// Treatment of deadlines that passed during a cycle that took too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OverrunPolicy {
    /// They are skipped; the next cycle starts at the next deadline.
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
    /// Its deadline, in nanoseconds of the clock.
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
