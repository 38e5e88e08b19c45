//! Waiting for OP while process data run.

use ecrt_sys::Errno;

use crate::adapter::{Adapter, Phase};
use crate::cycle::CycleError;
use crate::diagnose::run_in_parallel;
use crate::error::Error;
use crate::master::SlaveConfigState;
use crate::operation_report::is_preop;

/// How often slow state is asked for while waiting, in nanoseconds.
const INSPECT_NS: u64 = 200_000_000;
/// Sends that a startup SDO takes: request, its fetching, and one in reserve.
const CYCLES_PER_SDO: u64 = 4;
/// Time for the states themselves, in milliseconds per slave.
const STATES_MS: u64 = 5_000;

/// A wait for OP that is under way; for applications that run the cycle themselves.
#[derive(Debug)]
pub struct OpWait {
    start_ns: u64,
    deadline_ns: u64,
    inspect_ns: u64,
}

/// How a wait for OP stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OpProgress {
    /// Every slave is in OP and exchanges process data.
    Reached,
    /// Not yet.
    Pending,
    /// Time is up, or a slave is held by an error that does not pass by waiting.
    Failed {
        /// How long was waited, in milliseconds.
        waited_ms: u64,
    },
}

impl Adapter {
    /// Waits until every slave is in OP and exchanges process data, running
    /// [`receive`](Self::receive) and [`send`](Self::send) every cycle meanwhile. Activates first
    /// if that has not been done.
    ///
    /// Blocks, for seconds: every startup SDO takes some cycles, and the master configures one
    /// slave after the other. [`startup_timeout_ms`](Self::startup_timeout_ms) tells what to
    /// allow. Not for the cycle.
    ///
    /// # Errors
    /// [`Error::NotOperational`] with a report that names slave, AL state, AL status code and
    /// failed SDO; or what went wrong in the cycle.
    pub fn wait_op(&mut self, timeout_ms: u32) -> Result<(), Error> {
        self.wait_op_with(timeout_ms, |adapter| {
            let received = adapter.receive();
            adapter.send().and(received)
        })
    }

    /// As [`wait_op`](Self::wait_op), with the application's own cycle.
    ///
    /// # Errors
    /// As there.
    pub fn wait_op_with(
        &mut self,
        timeout_ms: u32,
        mut cycle: impl FnMut(&mut Self) -> Result<(), CycleError>,
    ) -> Result<(), Error> {
        let mut wait = self.begin_op_wait(timeout_ms)?;
        loop {
            self.wait_next_cycle();
            // A single cycle may fail; the deadline ends it all.
            let result = cycle(self);
            if self.should_stop() {
                return Err(Error::Stopped);
            }
            match self.op_progress(&mut wait)? {
                OpProgress::Reached => return Ok(()),
                OpProgress::Pending => {}
                OpProgress::Failed { waited_ms } => {
                    result?;
                    let mut report = self.not_operational(waited_ms)?;
                    let work = report.investigation(self);
                    let clock = self.ecrt.clock().clone();
                    let open = self.diagnostics_opener();
                    let causes = run_in_parallel(clock.as_ref(), open, work, || {
                        self.wait_next_cycle();
                        let _ = cycle(self);
                    })?;
                    report.explain(causes);
                    return Err(Error::NotOperational(Box::new(report)));
                }
            }
        }
    }

    /// Begins to wait for OP, for applications that run the cycle themselves: activates where that
    /// has not been done and is not the owner's business.
    ///
    /// # Errors
    /// Activation failed.
    pub fn begin_op_wait(&mut self, timeout_ms: u32) -> Result<OpWait, Error> {
        if self.phase == Phase::Configured && !self.is_attached() {
            self.activate()?;
        }
        for slave in &mut self.slaves {
            slave.al_status.clear();
        }
        let start_ns = self.ecrt.clock().now_ns();
        let deadline_ns = start_ns + u64::from(timeout_ms) * 1_000_000;
        Ok(OpWait { start_ns, deadline_ns, inspect_ns: start_ns + INSPECT_NS })
    }

    /// How a wait stands, once after each cycle. May block briefly: not for the cycle proper.
    ///
    /// # Errors
    /// The library's error.
    pub fn op_progress(&mut self, wait: &mut OpWait) -> Result<OpProgress, Error> {
        if self.all_operational()? {
            return Ok(OpProgress::Reached);
        }
        for slave in &mut self.slaves {
            slave.al_status.step(&mut self.master);
        }
        let now = self.ecrt.clock().now_ns();
        let inspects = now >= wait.inspect_ns;
        if inspects {
            wait.inspect_ns = now + INSPECT_NS;
        }
        if now >= wait.deadline_ns || inspects && self.a_slave_is_held() {
            return Ok(OpProgress::Failed { waited_ms: (now - wait.start_ns) / 1_000_000 });
        }
        Ok(OpProgress::Pending)
    }

    /// How long the way to OP may take, in milliseconds: the master configures one slave after
    /// the other, and every startup SDO takes a few cycles.
    pub fn startup_timeout_ms(&self) -> u32 {
        let slaves = self.config.slaves.iter();
        let downloads: u64 = slaves.map(|slave| crate::startup::download_count(slave) as u64).sum();
        let transfers_ms = downloads * CYCLES_PER_SDO * u64::from(self.config.cycle_ns) / 1_000_000;
        let total = transfers_ms + downloads * 5 + STATES_MS * (self.slave_count() as u64 + 1);
        u32::try_from(total).unwrap_or(u32::MAX)
    }

    /// Online, OP and AL state of a slave as the master's configuration sees it. It lags the
    /// working counter by seconds. Real-time safe.
    ///
    /// # Errors
    /// The library's error; an index out of range is `EINVAL`.
    pub fn slave_state(&self, slave: usize) -> Result<SlaveConfigState, CycleError> {
        let failed = CycleError::of_slave("ecrt_slave_config_state", slave);
        match self.slaves.get(slave) {
            Some(slave) => self.master.config_state(slave.config).map_err(failed),
            None => Err(failed(Errno::EINVAL)),
        }
    }

    /// Whether every slave is in OP and exchanged both directions in the last cycle.
    ///
    /// # Errors
    /// The library's error.
    pub fn all_operational(&self) -> Result<bool, CycleError> {
        for slave in 0..self.slaves.len() {
            if !self.slave_state(slave)?.operational {
                return Ok(false);
            }
        }
        Ok(self.domain_is_complete())
    }

    /// A slave that the master holds in PREOP does not get on by waiting.
    fn a_slave_is_held(&self) -> bool {
        (0..self.slaves.len()).any(|slave| {
            self.diagnostics
                .slave_info(slave)
                .is_ok_and(|info| info.error_flag && is_preop(info.al_state))
        })
    }
}
