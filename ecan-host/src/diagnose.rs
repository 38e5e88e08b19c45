//! Blocking work beside a running cycle.

use std::panic::resume_unwind;
use std::sync::Barrier;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use ecrt_sys::Clock;

use crate::adapter::{Adapter, Phase};
use crate::cycle::CycleError;
use crate::diagnostics::Diagnostics;
use crate::error::Error;

/// A thread beside the cycle, from its first to its last step, also where it panics.
struct WorkerGuard<'a> {
    clock: &'a dyn Clock,
    is_done: &'a AtomicBool,
}

impl Drop for WorkerGuard<'_> {
    fn drop(&mut self) {
        // In this order: whoever sees the clock go on sees also that the work is done.
        self.is_done.store(true, Ordering::Release);
        self.clock.leave_beside();
    }
}

/// Runs `work` with a diagnostics handle on another thread, and `cycle` on this one until `work`
/// is done. `cycle` is one whole cycle with its waiting; at least one is run.
pub fn run_beside<R: Send>(
    diagnostics: Diagnostics,
    work: impl FnOnce(&Diagnostics) -> R + Send,
    mut cycle: impl FnMut(),
) -> R {
    let clock = diagnostics.ecrt.clock().clone();
    let (clock, is_done) = (clock.as_ref(), &AtomicBool::new(false));
    // Only a clock that is stepped waits for the thread, and then from its very start.
    let begun = &(!clock.runs_by_itself()).then(|| Barrier::new(2));
    thread::scope(|scope| {
        let worker = scope.spawn(move || {
            clock.enter_beside();
            let _beside = WorkerGuard { clock, is_done };
            begun.as_ref().map(Barrier::wait);
            work(&diagnostics)
        });
        begun.as_ref().map(Barrier::wait);
        loop {
            cycle();
            if is_done.load(Ordering::Acquire) {
                break;
            }
        }
        worker.join().unwrap_or_else(|panic| resume_unwind(panic))
    })
}

impl Adapter {
    /// Runs `work` with a diagnostics handle of its own, while the cycle goes on.
    ///
    /// On an active bus `work` runs on another thread and `cycle` on this one, every cycle, until
    /// `work` is done; otherwise `work` just runs. Blocks; for SDO transfers in or between
    /// cycles use [`create_sdo_request`](Self::create_sdo_request).
    ///
    /// # Errors
    /// The handle cannot be opened. Errors of single cycles do not end the work.
    pub fn diagnose<R: Send>(
        &mut self,
        mut cycle: impl FnMut(&mut Self) -> Result<(), CycleError>,
        work: impl FnOnce(&Diagnostics) -> R + Send,
    ) -> Result<R, Error> {
        if self.phase != Phase::Active {
            return Ok(work(&self.diagnostics));
        }
        let diagnostics = self.open_diagnostics()?;
        Ok(run_beside(diagnostics, work, || {
            self.wait_next_cycle();
            // The transfer needs the bus to go on, whatever a single cycle says.
            let _ = cycle(self);
        }))
    }
}
