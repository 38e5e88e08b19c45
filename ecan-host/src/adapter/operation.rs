//! Waiting for OP, and leaving it, while process data run; the slaves that are not in OP.

use std::time::Duration;

use tracing::{info, warn};

use super::bring_up::StartupRounds;
use super::cycle_clock::deadline_ns;
use super::slave::Slave;
use super::{Adapter, StopCheck, should_stop};
use crate::bus::{Diagnostics, run_in_parallel};
use crate::config::StartupStep;
use crate::error::{Error, NotOperational, SlaveReport, is_preop};
use crate::exchange::{CycleError, Delivery, Phase};
use crate::master::RequestState;

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

/// A slave that leaves OP.
struct OpExit {
    slave: usize,
    is_requested: bool,
}

impl OpExit {
    /// Requests the exit, again after a failure. Returns whether the slave has left OP.
    fn has_ended(&mut self, adapter: &mut Adapter) -> bool {
        if !self.is_requested {
            self.is_requested = adapter.requests().reconfigure(self.slave).is_ok();
            return false;
        }
        match adapter.requests().reconfiguration_state(self.slave) {
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

impl OpWait {
    /// Begins to wait for OP, for applications that run the cycle themselves: activates where that
    /// has not been done, except on an attached Adapter.
    pub fn begin(adapter: &mut Adapter, timeout: Duration) -> Result<Self, Error> {
        if adapter.phase == Phase::Configured && !adapter.is_attached() {
            adapter.activate()?;
        }
        for slave in &mut adapter.slaves {
            slave.al_status_mut().clear();
        }
        let start_ns = adapter.clock().now_ns();
        let deadline_ns = deadline_ns(adapter.clock(), timeout);
        Ok(Self { start_ns, deadline_ns, inspect_ns: start_ns + INSPECT_NS })
    }

    /// Progress of the wait; call it once after each cycle. May block briefly: not for the cycle itself.
    pub fn progress(&mut self, adapter: &mut Adapter) -> Result<OpProgress, Error> {
        if adapter.all_operational()? {
            let waited_ms = (adapter.clock().now_ns() - self.start_ns) / 1_000_000;
            info!(waited_ms, "all slaves: OP reached (after {waited_ms} ms)");
            return Ok(OpProgress::Reached);
        }
        for slave in &mut adapter.slaves {
            slave.al_status_mut().step(&mut adapter.master);
        }
        let now_ns = adapter.clock().now_ns();
        let inspects = now_ns >= self.inspect_ns;
        if inspects {
            self.inspect_ns = now_ns + INSPECT_NS;
        }
        if now_ns >= self.deadline_ns || inspects && note_held_slaves(adapter) {
            let waited_ms = (now_ns - self.start_ns) / 1_000_000;
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
    pub fn retry(&self, adapter: &mut Adapter, report: &NotOperational) -> Result<bool, Error> {
        if adapter.is_attached() || adapter.clock().now_ns() >= self.deadline_ns {
            return Ok(false);
        }
        let mut held =
            report.held().filter(|slave| is_held(&adapter.diagnostics, slave.slave)).peekable();
        if held.peek().is_none() {
            // Another startup has begun, for which the causes do not apply.
            return Ok(report.held().next().is_some());
        }
        if !held.all(SlaveReport::is_temporary) {
            return Ok(false);
        }
        info!("startup of the slaves in PREOP: repeated");
        adapter.retry_startup()?;
        Ok(true)
    }
}

/// Returns whether the master holds a slave in PREOP, and notes each.
fn note_held_slaves(adapter: &mut Adapter) -> bool {
    let mut is_any_held = false;
    for (index, slave) in adapter.slaves.iter_mut().enumerate() {
        if is_held(&adapter.diagnostics, index) {
            slave.al_status_mut().note_held();
            is_any_held = true;
        }
    }
    is_any_held
}

/// Returns whether the master holds a slave in PREOP, so that waiting does not help.
fn is_held(diagnostics: &Diagnostics, slave: usize) -> bool {
    let info = diagnostics.slave_info(slave);
    info.is_ok_and(|info| info.error_flag && is_preop(info.al_state))
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
        should_stop(&self.publisher, self.stop.as_ref())
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
        let result = run_until_op(self, timeout, cycle);
        self.set_startup_rounds(StartupRounds::Off);
        result
    }

    /// Takes the slaves out of OP and exchanges their process data until they have left it, for at most
    /// 20 cycles: the images of the last cycle once more. Call it after the last cycle if the program
    /// does other work before it drops the Adapter, which also calls it.
    ///
    /// The master returns the slaves to PREOP only some time after its release, for instance when it has
    /// read an SDO dictionary. The process data watchdog would run out before, with AL status code
    /// 0x001B. Without effect on an attached Adapter, whose owner ends the exchange. Not for the cycle.
    pub fn leave_op(&mut self) {
        if self.phase != Phase::Active || self.is_attached() || self.is_leaving_op {
            return;
        }
        self.is_leaving_op = true;
        let mut exits: Vec<OpExit> = (0..self.slaves.len())
            .filter(|slave| may_be_in_op(self, *slave))
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

    /// Time in which the slaves reach OP: the master configures one slave after the other, and every
    /// startup SDO takes a few cycles and the time that a transfer to this slave took when the Adapter
    /// was opened, at most 200 ms. Allocates; not for the cycle.
    pub fn startup_timeout(&self) -> Duration {
        let of_slave = |slave| {
            let downloads = self.startup.download_count(&self.config, slave);
            let measured = self.slaves.get(slave).map_or(SDO_TIME, Slave::sdo_time);
            let sdo_time = measured.clamp(SDO_TIME, SDO_TIME_MAX);
            (self.config.cycle * CYCLES_PER_SDO + sdo_time)
                * u32::try_from(downloads).unwrap_or(u32::MAX)
        };
        let count = self.slave_count();
        let sdos: Duration = (0..count).map(of_slave).sum();
        sdos + STATES_TIME * (u32::try_from(count).unwrap_or(u32::MAX) + 1)
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
}

impl Drop for Adapter {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.leave_op();
        }
    }
}

fn run_until_op(
    adapter: &mut Adapter,
    timeout: Duration,
    mut cycle: impl FnMut(&mut Adapter) -> Result<(), CycleError>,
) -> Result<(), Error> {
    let mut wait = OpWait::begin(adapter, timeout)?;
    loop {
        adapter.wait_next_cycle();
        // A single cycle may fail; the deadline ends it all.
        let result = cycle(adapter);
        if adapter.should_stop() {
            return Err(Error::Stopped);
        }
        match wait.progress(adapter)? {
            OpProgress::Reached => return Ok(()),
            OpProgress::Pending => {}
            OpProgress::Failed { waited_ms } => {
                result?;
                let mut report = NotOperational::find(adapter, waited_ms)?;
                let work = report.investigation(adapter);
                let clock = adapter.ecrt.clock().clone();
                let open = adapter.diagnostics_opener();
                let causes = run_in_parallel(clock.as_ref(), open, work, || {
                    adapter.wait_next_cycle();
                    let _ = cycle(adapter);
                })?;
                report.explain(causes);
                if !wait.retry(adapter, &report)? {
                    return Err(Error::NotOperational(Box::new(report)));
                }
            }
        }
    }
}

/// Returns whether the slave is in OP by the last exchange or by its state, which lags.
fn may_be_in_op(adapter: &Adapter, slave: usize) -> bool {
    adapter.domain_report(slave).outputs == Delivery::Confirmed
        || adapter.slave_state(slave).is_ok_and(|state| state.operational)
}

impl NotOperational {
    /// The slaves that are not in OP now, without what takes blocking transfers.
    pub fn find(adapter: &Adapter, waited_ms: u64) -> Result<Self, Error> {
        let mut slaves = Vec::new();
        for (index, slave) in adapter.slaves.iter().enumerate() {
            let state = adapter.slave_state(index)?;
            let domain = adapter.domain_report(index);
            if state.operational && domain.is_complete() {
                continue;
            }
            let info = adapter.diagnostics.slave_info(index).ok();
            let slave_config = adapter.config.slaves.get(index);
            slaves.push(SlaveReport {
                slave: index,
                alias: slave_config.map_or(0, |settings| settings.alias),
                position: slave_config.map_or(0, |settings| settings.position),
                master_index: adapter.config.master_index,
                ring_position: info.as_ref().map(|info| info.position),
                online: state.online,
                al_state: info
                    .as_ref()
                    .map(|info| info.al_state)
                    .or(state.online.then_some(state.al_state)),
                error_flag: info.is_some_and(|info| info.error_flag),
                was_held: slave.al_status().was_held(),
                al_status_code: slave.al_status().last(),
                sync_managers: slave.al_status().sync_managers(),
                uses_sync0: adapter.config.dc.is_some(),
                cause: None,
                working_counter: domain.working_counter,
                expected_working_counter: domain.expected_working_counter,
            });
        }
        Ok(Self { waited_ms, slaves })
    }

    /// The blocking transfers that find the causes, for
    /// [`run_in_parallel`].
    pub fn investigation(
        &self,
        adapter: &Adapter,
    ) -> impl FnOnce(&Diagnostics) -> Vec<(usize, Error)> + Send + use<> {
        let work: Vec<(usize, Vec<StartupStep>)> = self
            .held()
            .filter_map(|report| {
                let slave = adapter.slaves.get(report.slave)?;
                let steps = adapter.startup.steps(&adapter.config, report.slave);
                Some((report.slave, slave.steps_to_try(&steps)))
            })
            .collect();
        move |diagnostics| {
            let failure = |(slave, steps): &(usize, Vec<StartupStep>)| {
                diagnostics.run_startup(*slave, steps, |_| {}).err().map(|error| (*slave, error))
            };
            work.iter().filter_map(failure).collect()
        }
    }

    /// Takes over what an [`investigation`](Self::investigation) found.
    pub fn explain(&mut self, causes: Vec<(usize, Error)>) {
        for (slave, error) in causes {
            if let Some(report) = self.slaves.iter_mut().find(|report| report.slave == slave) {
                report.cause = Some(Box::new(error));
            }
        }
    }
}
