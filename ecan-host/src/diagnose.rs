//! Blocking work beside a running cycle.

use std::panic::resume_unwind;
use std::thread;

use crate::adapter::{Adapter, Phase};
use crate::cycle::CycleError;
use crate::diagnostics::Diagnostics;
use crate::error::Error;

/// Runs `work` with a diagnostics handle on another thread, and `cycle` on this one until `work`
/// is done. `cycle` is one whole cycle with its waiting.
pub fn run_beside<R: Send>(
    diagnostics: Diagnostics,
    work: impl FnOnce(&Diagnostics) -> R + Send,
    mut cycle: impl FnMut(),
) -> R {
    thread::scope(|scope| {
        let worker = scope.spawn(move || work(&diagnostics));
        while !worker.is_finished() {
            cycle();
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
