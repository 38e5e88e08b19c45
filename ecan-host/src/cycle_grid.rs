//! The grid of cycle starts: one for waiting, for the application, and for the clocks.

use crate::adapter::Adapter;

impl Adapter {
    /// Sleeps until the next cycle is due and gives the number of cycles that were skipped because
    /// they had passed already.
    ///
    /// All waiting of the SDK keeps the same grid, so an application that goes on with it after
    /// [`wait_op`](Self::wait_op) stays in phase with Sync0. The first call starts the grid. An
    /// application with a cycle timer of its own need not call it; then the time of each
    /// [`receive`](Self::receive) is the time of its cycle.
    pub fn wait_next_cycle(&mut self) -> u64 {
        let clock = self.ecrt.clock();
        let cycle_ns = u64::from(self.config.cycle_ns.max(1));
        let now = clock.now_ns();
        let Some(last) = self.grid_ns else {
            self.grid_ns = Some(now);
            self.cycle_due_ns = Some(now);
            return 0;
        };
        let skipped = now.saturating_sub(last) / cycle_ns;
        let next = last + (skipped + 1) * cycle_ns;
        self.grid_ns = Some(next);
        self.cycle_due_ns = Some(next);
        clock.sleep_until_ns(next);
        skipped
    }

    /// The time that the running cycle has on the grid, in nanoseconds of the library's clock.
    pub fn cycle_time_ns(&self) -> u64 {
        self.cycle_time_ns
    }

    /// Fixes the time of the cycle that starts now.
    pub(crate) fn start_cycle(&mut self) {
        let due = self.cycle_due_ns.take();
        self.cycle_time_ns = due.unwrap_or_else(|| self.ecrt.clock().now_ns());
    }
}
