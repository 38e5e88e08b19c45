//! Running the cycle while something slower is waited for.

use ecan_host::{Diagnostics, OpProgress, Phase, run_in_parallel};

use crate::error::PortError;
use crate::port::Port;

/// A cycle in which nothing is sent and what comes back is thrown away.
fn empty_cycle(port: &mut Port) -> Result<(), PortError> {
    let begun = port.cycle_begin();
    // Single cycles may fail; the deadline ends it all.
    let _ = port.cycle_end().and(begun);
    Ok(())
}

impl Port {
    /// Activates the bus if that has not been done, and runs the cycle until every gateway is in
    /// OP, verified and in service.
    ///
    /// Blocks, for seconds; [`startup_timeout_ms`](Self::startup_timeout_ms) tells what to allow.
    /// Received frames are thrown away meanwhile. Goes on with
    /// [`wait_next_cycle`](Self::wait_next_cycle).
    ///
    /// # Errors
    /// [`PortError::Adapter`] with a report of the slaves that do not reach OP,
    /// [`PortError::NotInService`] for one that does but is not in service, with the step that it
    /// waits for, or what went wrong in the cycle.
    pub fn wait_ready(&mut self, timeout_ms: u32) -> Result<(), PortError> {
        self.wait_ready_with(timeout_ms, empty_cycle)
    }

    /// As [`wait_ready`](Self::wait_ready), with a cycle of the application: between
    /// `cycle_begin` and `cycle_end` it may do as it likes, and on an attached Adapter the
    /// owner's receive comes before and its send after. It may also end the wait with an error.
    ///
    /// # Errors
    /// As there, and the application's.
    pub fn wait_ready_with<E: From<PortError>>(
        &mut self,
        timeout_ms: u32,
        mut cycle: impl FnMut(&mut Self) -> Result<(), E>,
    ) -> Result<(), E> {
        let failed = |error| E::from(PortError::Adapter(error));
        let mut wait = self.adapter.begin_op_wait(timeout_ms).map_err(failed)?;
        let clock = self.adapter.ecrt().clock().clone();
        let start = clock.now_ns();
        let mut is_operational = false;
        loop {
            self.wait_next_cycle();
            cycle(self)?;
            if self.adapter.should_stop() {
                return Err(failed(ecan_host::Error::Stopped));
            }
            if is_operational && self.is_ready() {
                return Ok(());
            }
            if is_operational {
                let waited_ms = (clock.now_ns() - start) / 1_000_000;
                if waited_ms > u64::from(timeout_ms) {
                    let open = self.gateways.iter().position(|g| !g.session.is_ready());
                    let slave = open.unwrap_or_default();
                    return Err(self.not_in_service(slave, waited_ms).into());
                }
                continue;
            }
            match self.adapter.op_progress(&mut wait).map_err(failed)? {
                OpProgress::Reached => is_operational = true,
                OpProgress::Pending => {}
                OpProgress::Failed { waited_ms } => {
                    let mut report = self.adapter.not_operational(waited_ms).map_err(failed)?;
                    let work = report.investigation(&self.adapter);
                    let open = self.adapter.diagnostics_opener();
                    let causes = run_in_parallel(clock.as_ref(), open, work, || {
                        self.wait_next_cycle();
                        let _ = cycle(self);
                    });
                    let causes = causes.map_err(failed)?;
                    report.explain(causes);
                    return Err(failed(ecan_host::Error::NotOperational(Box::new(report))));
                }
            }
        }
    }

    fn not_in_service(&self, slave: usize, waited_ms: u64) -> PortError {
        PortError::NotInService {
            slave,
            session: self.session(slave),
            waiting_for: self.waiting_for(slave),
            last_fault: self.last_verification_fault(slave),
            waited_ms,
        }
    }

    /// Sleeps until the next cycle is due: see [`Adapter::wait_next_cycle`](ecan_host::Adapter::wait_next_cycle).
    pub fn wait_next_cycle(&mut self) -> u64 {
        let skipped = self.adapter.wait_next_cycle();
        // The owner of an attached master sets Sync0 by a grid of its own.
        let is_in_phase = !self.adapter.is_attached();
        self.cycle_point_ns = is_in_phase.then_some(self.adapter.cycle_start().deadline_ns);
        skipped
    }

    /// How long the way into service may take, in milliseconds: see
    /// [`Adapter::startup_timeout_ms`](ecan_host::Adapter::startup_timeout_ms).
    pub fn startup_timeout_ms(&self) -> u32 {
        self.adapter.startup_timeout_ms()
    }

    /// Runs `work` with a diagnostics handle of its own while the cycle goes on: blocking SDO
    /// transfers on a running bus. Received frames are thrown away meanwhile, and nothing is sent.
    ///
    /// # Errors
    /// The handle cannot be opened.
    pub fn diagnose<R: Send>(
        &mut self,
        work: impl FnOnce(&Diagnostics) -> R + Send,
    ) -> Result<R, PortError> {
        self.diagnose_with(empty_cycle, work)
    }

    /// As [`diagnose`](Self::diagnose), with a cycle of the application.
    ///
    /// # Errors
    /// As there. Errors of single cycles do not end the work.
    pub fn diagnose_with<R: Send, E>(
        &mut self,
        mut cycle: impl FnMut(&mut Self) -> Result<(), E>,
        work: impl FnOnce(&Diagnostics) -> R + Send,
    ) -> Result<R, PortError> {
        if self.adapter.phase() != Phase::Active {
            return Ok(work(&self.adapter.open_diagnostics()?));
        }
        let clock = self.adapter.ecrt().clock().clone();
        let open = self.adapter.diagnostics_opener();
        Ok(run_in_parallel(clock.as_ref(), open, work, || {
            self.wait_next_cycle();
            let _ = cycle(self);
        })?)
    }
}
