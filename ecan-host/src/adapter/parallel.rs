//! Blocking work in parallel with a running cycle.

use std::panic::resume_unwind;
use std::sync::Barrier;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use ecrt_sys::Clock;

use super::Adapter;
use crate::bus::Diagnostics;
use crate::error::{CycleError, Error};
use crate::phase::Phase;

/// Reports the end of the work, also after a panic.
struct WorkerGuard<'a>(&'a AtomicBool);

impl Drop for WorkerGuard<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Runs `work` on another thread, with the diagnostics handle that `open` returns there, and
/// `cycle` on this one until `work` is done. `cycle` is one whole cycle including its wait; at
/// least one is run.
pub fn run_in_parallel<R: Send>(
    clock: &dyn Clock,
    open: impl FnOnce() -> Result<Diagnostics, Error> + Send,
    work: impl FnOnce(&Diagnostics) -> R + Send,
    mut cycle: impl FnMut(),
) -> Result<R, Error> {
    let is_done = &AtomicBool::new(false);
    // On a stepped clock no cycle runs until the worker has its handle: so every run is the same.
    let opened = &(!clock.is_free_running()).then(|| Barrier::new(2));
    thread::scope(|scope| {
        let worker = scope.spawn(move || {
            let guard = WorkerGuard(is_done);
            let diagnostics = open();
            opened.as_ref().map(Barrier::wait);
            let diagnostics = diagnostics?;
            let result = work(&diagnostics);
            // Before the handle is released: stepped time moves only when the work is reported done.
            drop(guard);
            Ok(result)
        });
        opened.as_ref().map(Barrier::wait);
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
    /// Runs `work` with a diagnostics handle of its own while the cycle continues.
    ///
    /// On an active bus `work` runs on another thread and `cycle` on this one, every cycle, until
    /// `work` is done; otherwise `work` runs on this thread. Blocks; for SDO transfers in or
    /// between cycles use [`create_sdo_request`](Self::create_sdo_request).
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
        let clock = self.ecrt.clock().clone();
        run_in_parallel(clock.as_ref(), self.diagnostics_opener(), work, || {
            self.wait_next_cycle();
            // The transfer needs a running bus, whatever the result of a single cycle.
            let _ = cycle(self);
        })
    }
}
