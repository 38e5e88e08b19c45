//! Waiting for OP, and leaving it, while process data run.

use std::fmt;
use std::time::Duration;

use ecrt_sys::Errno;
use tracing::{info, warn};

use super::{Adapter, Delivery, StartupRounds, run_in_parallel};
use crate::deadline::deadline_ns;
use crate::error::{CycleError, Error, NotOperational, SlaveReport, is_preop};
use crate::master::{RequestState, SlaveConfigState};
use crate::phase::Phase;

/// Longest time in which slaves leave OP: a register request needs at most six cycles, and the device
/// some milliseconds.
const LEAVE_CYCLES: u32 = 20;
/// Interval of slow queries while waiting, in nanoseconds.
const INSPECT_NS: u64 = 200_000_000;
/// Cycles of a startup SDO: request, fetching the response, and a reserve.
const CYCLES_PER_SDO: u32 = 4;
/// Bounds of the part of a startup SDO's time that does not depend on the cycle.
const SDO_TIME: Duration = Duration::from_millis(5);
const SDO_TIME_MAX: Duration = Duration::from_millis(200);
const STATES_TIME: Duration = Duration::from_secs(5);

/// Function of the application that decides whether to end a wait.
pub(super) struct StopCheck(pub(super) Box<dyn Fn() -> bool + Send>);

impl fmt::Debug for StopCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("StopCheck")
    }
}

/// A slave that leaves OP.
struct OpExit {
    slave: usize,
    is_requested: bool,
}

impl OpExit {
    /// Requests the exit, again after a failure. Returns whether the slave has left OP.
    fn has_ended(&mut self, adapter: &mut Adapter) -> bool {
        if !self.is_requested {
            self.is_requested = adapter.request_reconfiguration(self.slave).is_ok();
            return false;
        }
        match adapter.reconfiguration_request_state(self.slave) {
            Ok(RequestState::Success) => {
                adapter.domain_report(self.slave).outputs != Delivery::Confirmed
            }
            Ok(RequestState::Busy) => false,
            _ => {
                self.is_requested = false;
                false
            }
        }
    }
}

/// A running wait for OP; for applications that run the cycle themselves.
#[derive(Debug)]
pub struct OpWait {
    start_ns: u64,
    deadline_ns: u64,
    inspect_ns: u64,
}

/// Progress of a wait for OP.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OpProgress {
    /// Every slave is in OP and exchanges process data.
    Reached,
    /// Some slave is not in OP yet.
    Pending,
    /// Time is up, or a slave is held by an error that does not pass by waiting.
    Failed {
        /// Time waited, in milliseconds.
        waited_ms: u64,
    },
}

impl Adapter {
    /// Sets a function that calls which wait by running the cycle call once in every cycle; if it
    /// returns true they end with [`Error::Stopped`]: a signal arrived, a button was pressed.
    ///
    /// The layers above use the same function. Calls that disable axes ignore it.
    pub fn stop_waiting_when(&mut self, stop: Option<Box<dyn Fn() -> bool + Send>>) {
        self.stop = stop.map(StopCheck);
    }

    /// Returns whether the application requests the end of calls that wait, by that function or by
    /// [`Observer::request_stop`](crate::Observer::request_stop).
    pub fn should_stop(&self) -> bool {
        self.is_stop_requested() || self.stop.as_ref().is_some_and(|stop| (stop.0)())
    }

    /// Waits until every slave is in OP and exchanges process data, running
    /// [`receive`](Self::receive) and [`send`](Self::send) every cycle. Activates first
    /// if that has not been done.
    ///
    /// Blocks, for seconds: every startup SDO takes some cycles, and the master configures one
    /// slave after the other. [`startup_timeout`](Self::startup_timeout) is a suitable
    /// `timeout`. Not for the cycle.
    ///
    /// # Errors
    /// [`Error::NotOperational`] with a report that names slave, AL state, AL status code and
    /// failed SDO; or what went wrong in the cycle.
    pub fn wait_op(&mut self, timeout: Duration) -> Result<(), Error> {
        self.wait_op_with(timeout, |adapter| {
            let received = adapter.receive();
            adapter.send().and(received)
        })
    }

    /// As [`wait_op`](Self::wait_op), with the application's own cycle.
    pub fn wait_op_with(
        &mut self,
        timeout: Duration,
        cycle: impl FnMut(&mut Self) -> Result<(), CycleError>,
    ) -> Result<(), Error> {
        self.set_startup_rounds(StartupRounds::UntilSafeOp);
        let result = self.run_until_op(timeout, cycle);
        self.set_startup_rounds(StartupRounds::Off);
        result
    }

    fn run_until_op(
        &mut self,
        timeout: Duration,
        mut cycle: impl FnMut(&mut Self) -> Result<(), CycleError>,
    ) -> Result<(), Error> {
        let mut wait = self.begin_op_wait(timeout)?;
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
                    if self.retry_wait(&wait, &report)? {
                        continue;
                    }
                    return Err(Error::NotOperational(Box::new(report)));
                }
            }
        }
    }

    /// Takes the slaves out of OP and exchanges their process data until they have left it, for at most
    /// 20 cycles: the images of the last cycle once more. Call it after the last cycle if the program
    /// does other work before it drops the Adapter, which also calls it.
    ///
    /// The master returns the slaves to PREOP only some time after its release, for instance when it has
    /// read an SDO dictionary. The process data watchdog would run out before, with AL status code
    /// 0x001B. Without effect on an attached Adapter, whose owner ends the exchange. Not for the cycle.
    pub fn leave_op(&mut self) {
        if self.phase != Phase::Active || self.attached || self.is_leaving_op {
            return;
        }
        self.is_leaving_op = true;
        let mut exits: Vec<OpExit> = (0..self.slaves.len())
            .filter(|slave| self.may_be_in_op(*slave))
            .map(|slave| OpExit { slave, is_requested: false })
            .collect();
        for _ in 0..LEAVE_CYCLES {
            exits.retain_mut(|exit| !exit.has_ended(self));
            if exits.is_empty() {
                return;
            }
            self.wait_next_cycle();
            // The exchange ends in any case, also after an error.
            let _ = self.exchange_inputs();
            let _ = self.send();
        }
    }

    /// Returns whether the slave is in OP by the last exchange or by its state, which lags.
    fn may_be_in_op(&self, slave: usize) -> bool {
        self.domain_report(slave).outputs == Delivery::Confirmed
            || self.slave_state(slave).is_ok_and(|state| state.operational)
    }

    /// Begins to wait for OP, for applications that run the cycle themselves: activates where that
    /// has not been done, except on an attached Adapter.
    pub fn begin_op_wait(&mut self, timeout: Duration) -> Result<OpWait, Error> {
        if self.phase == Phase::Configured && !self.is_attached() {
            self.activate()?;
        }
        for slave in &mut self.slaves {
            slave.al_status.clear();
        }
        let start_ns = self.ecrt.clock().now_ns();
        let deadline_ns = deadline_ns(self.ecrt.clock().as_ref(), timeout);
        Ok(OpWait { start_ns, deadline_ns, inspect_ns: start_ns + INSPECT_NS })
    }

    /// Progress of a wait; call it once after each cycle. May block briefly: not for the cycle itself.
    pub fn op_progress(&mut self, wait: &mut OpWait) -> Result<OpProgress, Error> {
        if self.all_operational()? {
            let waited_ms = (self.ecrt.clock().now_ns() - wait.start_ns) / 1_000_000;
            info!(waited_ms, "all slaves: OP reached (after {waited_ms} ms)");
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
            let waited_ms = (now - wait.start_ns) / 1_000_000;
            warn!(waited_ms, "OP not reached (after {waited_ms} ms)");
            return Ok(OpProgress::Failed { waited_ms });
        }
        Ok(OpProgress::Pending)
    }

    /// Returns whether to go on with a wait that has failed: there is time left, and every slave that the
    /// master keeps in PREOP can succeed in another attempt, which is requested here unless another
    /// startup has begun since the report. Blocks; on an attached Adapter it does nothing.
    ///
    /// # Errors
    /// The library's error.
    pub fn retry_wait(&mut self, wait: &OpWait, report: &NotOperational) -> Result<bool, Error> {
        if self.attached || self.ecrt.clock().now_ns() >= wait.deadline_ns {
            return Ok(false);
        }
        let mut held = report.held().filter(|it| self.is_held(it.slave)).peekable();
        if held.peek().is_none() {
            // Another startup has begun, for which the causes do not apply.
            return Ok(report.held().next().is_some());
        }
        if !held.all(SlaveReport::is_temporary) {
            return Ok(false);
        }
        info!("startup of the slaves in PREOP: repeated");
        self.retry_startup()?;
        Ok(true)
    }

    /// Time in which the slaves reach OP: the master configures one slave after the other, and every
    /// startup SDO takes a few cycles and the time that a transfer to this slave took when the Adapter
    /// was opened, at most 200 ms. Allocates; not for the cycle.
    pub fn startup_timeout(&self) -> Duration {
        let of_slave = |slave| {
            let downloads = self.startup.download_count(&self.config, slave);
            let measured = self.slaves.get(slave).map_or(SDO_TIME, |slave| slave.sdo_time);
            let sdo_time = measured.clamp(SDO_TIME, SDO_TIME_MAX);
            (self.config.cycle * CYCLES_PER_SDO + sdo_time)
                * u32::try_from(downloads).unwrap_or(u32::MAX)
        };
        let count = self.slave_count();
        let sdos: Duration = (0..count).map(of_slave).sum();
        sdos + STATES_TIME * (u32::try_from(count).unwrap_or(u32::MAX) + 1)
    }

    /// Online, OP and AL state of a slave as the master's configuration sees it. It lags the
    /// working counter by seconds. Real-time safe.
    pub fn slave_state(&self, slave: usize) -> Result<SlaveConfigState, CycleError> {
        let failed = CycleError::of_slave("ecrt_slave_config_state", slave);
        match self.slaves.get(slave) {
            Some(slave) => self.master.config_state(slave.config).map_err(failed),
            None => Err(failed(Errno::EINVAL)),
        }
    }

    /// Takes a CoE emergency of a slave (8 bytes: error code, error register, data). The master receives it with
    /// the response of an SDO transfer, and keeps eight; on an attached Adapter the owner sets the size of the queue.
    /// `None` without one; then IgH writes a line to stderr. Not real-time safe; not for the cycle.
    pub fn take_emergency(&mut self, slave: usize) -> Option<[u8; 8]> {
        let config = self.slaves.get(slave)?.config;
        self.master.take_emergency(config).ok()
    }

    /// Returns whether every slave is in OP and exchanged both directions in the last cycle.
    pub fn all_operational(&self) -> Result<bool, CycleError> {
        for slave in 0..self.slaves.len() {
            if !self.slave_state(slave)?.operational {
                return Ok(false);
            }
        }
        Ok(self.domain_is_complete())
    }

    /// Returns whether the master holds a slave in PREOP, and notes each.
    fn a_slave_is_held(&mut self) -> bool {
        let mut is_any_held = false;
        for index in 0..self.slaves.len() {
            if self.is_held(index)
                && let Some(slave) = self.slaves.get_mut(index)
            {
                slave.al_status.note_held();
                is_any_held = true;
            }
        }
        is_any_held
    }

    /// A slave that the master holds in PREOP does not get on by waiting.
    fn is_held(&self, slave: usize) -> bool {
        let info = self.diagnostics.slave_info(slave);
        info.is_ok_and(|info| info.error_flag && is_preop(info.al_state))
    }
}

impl Drop for Adapter {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.leave_op();
        }
    }
}
