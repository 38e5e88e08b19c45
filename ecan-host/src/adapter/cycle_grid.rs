//! The grid of cycle deadlines, shared by waiting calls, the application and the clocks.

use std::fmt;
use std::sync::Arc;

use ecrt_sys::Clock;

use super::Adapter;
use crate::clocks::{ClockStatus, DistributedClocks};
use crate::real_time::{CycleStart, CycleStatistics, CycleTiming, TimerWait};

/// A wait for the next deadline, from [`Adapter::begin_wait`]. It borrows nothing.
#[must_use = "the cycle starts after the sleep"]
pub struct CycleWait {
    timer: TimerWait,
    clock: Arc<dyn Clock>,
}

impl CycleWait {
    /// Sleeps until the deadline, with the final spin of [`Adapter::set_cycle_timing`]. Real-time
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

impl Adapter {
    /// Sleeps until the next deadline and returns the number of deadlines that were skipped because
    /// they had passed already.
    ///
    /// All waiting calls of the SDK use the same grid, so an application that continues with it
    /// after [`wait_op`](Self::wait_op) stays in phase with Sync0. The first call starts the grid.
    /// An application with its own cycle timer need not call it; then the time of each
    /// [`receive`](Self::receive) is the time of its cycle.
    ///
    /// A cycle lasts until the response of the bus, [`response_ns`](Self::response_ns) after the
    /// last [`send`](Self::send); a late send may therefore miss the next deadline. A datagram that
    /// is sent again before its response loses the response, and with it the TxPDO image. On an
    /// attached Adapter the owner sends later and more; the owner must leave the time for that.
    ///
    /// [`set_cycle_timing`](Self::set_cycle_timing) selects a spin before the deadline, and catching
    /// up instead of skipping. Real-time safe: it does not allocate.
    pub fn wait_next_cycle(&mut self) -> u64 {
        let start = self.begin_wait().sleep();
        self.end_wait(start)
    }

    /// First part of [`wait_next_cycle`](Self::wait_next_cycle), for an application that protects the
    /// Adapter by a lock: other threads may use it during [`CycleWait::sleep`], which does not.
    /// [`end_wait`](Self::end_wait) is the last part. Real-time safe.
    pub fn begin_wait(&mut self) -> CycleWait {
        self.exchange_startup_rounds();
        let answered_ns = self.sent_ns.saturating_add(self.response_ns);
        let clock = self.ecrt.clock().clone();
        CycleWait { timer: self.cycle_timer.begin_wait(clock.now_ns(), answered_ns), clock }
    }

    /// Last part of [`wait_next_cycle`](Self::wait_next_cycle): the cycle starts. Returns the number
    /// of deadlines that were skipped. Real-time safe.
    pub fn end_wait(&mut self, start: CycleStart) -> u64 {
        self.cycle_timer.end_wait(&start);
        self.cycle_start = start;
        self.cycle_due_ns = Some(start.deadline_ns);
        self.overruns.update(start.skipped);
        if let Some(statistics) = &mut self.cycle_statistics {
            statistics.begin(&start);
        }
        start.skipped
    }

    /// Result of the last [`wait_next_cycle`](Self::wait_next_cycle): deadline, delay, skipped
    /// deadlines; all 0 before the first. For
    /// [`CycleStatistics::begin`](crate::CycleStatistics::begin). Real-time safe.
    pub fn cycle_start(&self) -> CycleStart {
        self.cycle_start
    }

    /// Starts or restarts the statistics of the cycle, as [`reconfigure`](Self::reconfigure) does:
    /// from the next [`wait_next_cycle`](Self::wait_next_cycle) on, each wait is a start and each
    /// [`send`](Self::send) an end. Allocates; not for the cycle.
    pub fn measure_cycles(&mut self) {
        self.cycle_statistics = Some(CycleStatistics::new(self.config.cycle_ns()));
    }

    /// Statistics since [`measure_cycles`](Self::measure_cycles); `None` without it.
    /// Real-time safe, but not its distributions.
    pub fn cycle_statistics(&self) -> Option<&CycleStatistics> {
        self.cycle_statistics.as_ref()
    }

    /// Sets final spin and overrun policy of [`wait_next_cycle`](Self::wait_next_cycle), from the
    /// next wait on; the grid stays. By default it neither spins nor catches up. A spin
    /// above [`MAX_SPIN_NS`](crate::MAX_SPIN_NS) is cut to that. Real-time safe.
    pub fn set_cycle_timing(&mut self, timing: CycleTiming) {
        self.cycle_timer.set_timing(timing);
    }

    /// The time that the running cycle has on the grid, in nanoseconds of the library's clock.
    pub fn cycle_time_ns(&self) -> u64 {
        self.cycle_time_ns
    }

    /// Waiting time for the response of the bus, in nanoseconds
    /// ([`Plan::response_ns`](crate::Plan::response_ns)). Real-time safe.
    pub fn response_ns(&self) -> u64 {
        self.response_ns
    }

    /// Differences of the distributed clocks; `None` without them, before activation, and on an
    /// attached Adapter, whose owner serves the clocks. Real-time safe.
    pub fn clock_status(&self) -> Option<ClockStatus> {
        self.clocks.as_ref().map(DistributedClocks::status)
    }

    /// Shift of the next deadline by the last [`receive`](Self::receive), in nanoseconds, so that
    /// the host follows the reference clock
    /// ([`ClockSource::Reference`](crate::ClockSource::Reference)); otherwise 0.
    /// [`wait_next_cycle`](Self::wait_next_cycle) applies it. Real-time safe.
    pub fn clock_correction_ns(&self) -> i64 {
        self.clock_correction_ns
    }

    /// The work of the cycle is done.
    pub(crate) fn end_cycle(&mut self) {
        self.sent_ns = self.ecrt.clock().now_ns();
        if let Some(statistics) = &mut self.cycle_statistics {
            statistics.end(self.sent_ns);
        }
    }

    pub(crate) fn correct_deadline(&mut self, by_ns: i64) {
        self.clock_correction_ns = by_ns;
        self.cycle_timer.shift(by_ns);
    }

    /// Fixes the time of the cycle that starts now.
    pub(crate) fn start_cycle(&mut self) {
        let due = self.cycle_due_ns.take();
        self.cycle_time_ns = due.unwrap_or_else(|| self.ecrt.clock().now_ns());
        if let Some(clocks) = &mut self.clocks {
            clocks.start_cycle(self.cycle_time_ns);
        }
    }
}
