//! Waiting for OP while process data run, and the report when a slave does not get there.

use std::fmt;

use ecan_protocol::{AlState, AlStatusCode, Direction};
use ecrt_sys::{Master, RegRequestId, RequestState, SlaveConfigState};

use crate::adapter::{Adapter, Phase};
use crate::capacity::Capacity;
use crate::config::SlaveSettings;
use crate::cycle::CycleError;
use crate::diagnostics::Diagnostics;
use crate::error::{Error, al_state_words};
use crate::startup::{StartupStep, run_steps, startup_list};

/// ESC register of the AL status code.
const AL_STATUS_CODE_REGISTER: u16 = 0x0134;
/// How often slow state is asked for while waiting, in nanoseconds.
const INSPECT_NS: u64 = 200_000_000;
/// Watches a slave's AL status code while OP is waited for.
///
/// The master acknowledges errors by itself, which clears the code, so the last one seen counts.
#[derive(Debug)]
pub(crate) struct AlStatusWatch {
    request: RegRequestId,
    last: Option<AlStatusCode>,
}

impl AlStatusWatch {
    pub(crate) fn new(request: RegRequestId) -> Self {
        Self { request, last: None }
    }

    /// Takes the code that a read has brought and starts the next read.
    fn step(&mut self, master: &mut Master) {
        let Ok(state) = master.reg_request_state(self.request) else { return };
        if state == RequestState::Busy {
            return;
        }
        if state == RequestState::Success
            && let [low, high, ..] = master.reg_request_data(self.request)
        {
            let code = u16::from_le_bytes([*low, *high]);
            self.last = (code != 0).then_some(AlStatusCode(code)).or(self.last);
        }
        // A slave that is gone refuses; the next step tries again.
        let _ = master.reg_request_read(self.request, AL_STATUS_CODE_REGISTER, 2);
    }
}

/// One slave that is not in OP, with everything the master can tell about it.
#[derive(Debug)]
pub struct SlaveReport {
    /// Slave index.
    pub slave: usize,
    /// Configured alias.
    pub alias: u16,
    /// Configured position.
    pub position: u16,
    /// Whether the slave answers at all.
    pub online: bool,
    /// AL state as a number; `None` when the slave does not answer.
    pub al_state: Option<u8>,
    /// Whether the slave reports an error with its state.
    pub error_flag: bool,
    /// Why, in the slave's words: the last code seen, since the master acknowledges errors and
    /// so clears them. `None` when none was caught.
    pub al_status_code: Option<AlStatusCode>,
    /// What is wrong with a slave that hangs in PREOP: the startup SDO that it refuses, or the
    /// object that does not fit the configured N.
    pub cause: Option<Box<Error>>,
    /// Working counter of its domain in the last cycle.
    pub working_counter: u32,
}

impl fmt::Display for SlaveReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "slave {} (alias {}, position {})", self.slave, self.alias, self.position)?;
        let Some(state) = self.al_state.filter(|_| self.online) else {
            return f.write_str(" does not answer: check its power and the cable to it");
        };
        write!(f, " is in {}", al_state_words(state))?;
        if self.error_flag {
            f.write_str(" with its error flag set")?;
        }
        if let Some(code) = self.al_status_code {
            write!(f, ", AL status code {code}")?;
        }
        if let Some(cause) = &self.cause {
            write!(f, ", because {cause}")?;
        }
        write!(f, ", working counter {}", self.working_counter)
    }
}

/// The slaves that did not reach OP in time.
#[derive(Debug)]
pub struct NotOperational {
    /// How long was waited, in milliseconds.
    pub waited_ms: u64,
    /// Every slave that is not in OP.
    pub slaves: Vec<SlaveReport>,
}

impl fmt::Display for NotOperational {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "not in OP after {} ms", self.waited_ms)?;
        self.slaves.iter().try_for_each(|slave| write!(f, "\n  - {slave}"))
    }
}

impl std::error::Error for NotOperational {}

fn is_preop(al_state: u8) -> bool {
    AlState::from_status(al_state.into()) == Some(AlState::PreOp)
}

impl Adapter {
    /// Waits until every slave is in OP and exchanges process data, running
    /// [`receive`](Self::receive) and [`send`](Self::send) every cycle meanwhile. Activates first
    /// if that has not been done.
    ///
    /// Blocks, for seconds. Not for the cycle.
    ///
    /// # Errors
    /// [`Error::NotOperational`] with a report that names slave, AL state, AL status code and
    /// failed SDO; or what went wrong in the cycle.
    pub fn wait_op(&mut self, timeout_ms: u32) -> Result<(), Error> {
        self.wait_op_with(timeout_ms, |adapter| {
            adapter.receive()?;
            adapter.send()
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
        if self.phase == Phase::Configured && !self.is_attached() {
            self.activate()?;
        }
        let clock = self.ecrt.clock().clone();
        let start = clock.now_ns();
        let deadline = start + u64::from(timeout_ms) * 1_000_000;
        let (mut next, mut inspect) = (start, start + INSPECT_NS);
        loop {
            cycle(self)?;
            if self.all_operational()? {
                return Ok(());
            }
            for slave in &mut self.slaves {
                slave.al_status.step(&mut self.master);
            }
            let now = clock.now_ns();
            let stuck = now >= inspect && self.a_slave_is_stuck();
            if stuck || now >= deadline {
                let waited_ms = (now - start) / 1_000_000;
                let report = self.not_operational(waited_ms, &mut cycle)?;
                return Err(Error::NotOperational(Box::new(report)));
            }
            if now >= inspect {
                inspect = now + INSPECT_NS;
            }
            next += u64::from(self.config.cycle_ns);
            clock.sleep_until_ns(next);
        }
    }

    /// Online, OP and AL state of a slave as the master's configuration sees it. It lags the
    /// working counter by seconds. Real-time safe.
    ///
    /// # Errors
    /// The library's error; an index out of range is `EINVAL`.
    pub fn slave_state(&self, slave: usize) -> Result<SlaveConfigState, CycleError> {
        let call = "ecrt_slave_config_state";
        let slave = self
            .slaves
            .get(slave)
            .ok_or(CycleError::Library { call, errno: ecrt_sys::Errno::EINVAL })?;
        self.master.config_state(slave.config).map_err(|errno| CycleError::Library { call, errno })
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

    /// A slave that reports an error in PREOP or below does not recover by waiting.
    fn a_slave_is_stuck(&self) -> bool {
        (0..self.slaves.len()).any(|slave| {
            self.diagnostics
                .slave_info(slave)
                .is_ok_and(|info| info.error_flag && is_preop(info.al_state))
        })
    }

    fn not_operational(
        &mut self,
        waited_ms: u64,
        cycle: &mut impl FnMut(&mut Self) -> Result<(), CycleError>,
    ) -> Result<NotOperational, Error> {
        let mut slaves = Vec::new();
        for slave in 0..self.slaves.len() {
            let state = self.slave_state(slave)?;
            if !state.operational || !self.domain_report(slave).is_complete() {
                slaves.push(self.slave_report(slave, state, cycle)?);
            }
        }
        Ok(NotOperational { waited_ms, slaves })
    }

    fn slave_report(
        &mut self,
        slave: usize,
        state: SlaveConfigState,
        cycle: &mut impl FnMut(&mut Self) -> Result<(), CycleError>,
    ) -> Result<SlaveReport, Error> {
        let info = self.diagnostics.slave_info(slave).ok();
        let online = state.online;
        let al_state = info.as_ref().map(|info| info.al_state).or(online.then_some(state.al_state));
        let working_counter = self.domain_report(slave).working_counter;
        let settings = self.config.slaves[slave].clone();
        let cause = if online && al_state.is_some_and(is_preop) {
            self.diagnose(cycle, |diagnostics| cause_in_preop(diagnostics, slave, &settings))?
        } else {
            None
        };
        Ok(SlaveReport {
            slave,
            alias: settings.alias,
            position: settings.position,
            online,
            al_state,
            error_flag: info.is_some_and(|info| info.error_flag),
            al_status_code: self.slave(slave)?.al_status.last,
            cause: cause.map(Box::new),
            working_counter,
        })
    }
}

/// Why a slave does not leave PREOP: a startup step that fails when it is tried again, or a profile
/// that does not fit the process data, which the gateway answers with AL status 0x001D or 0x001E.
fn cause_in_preop(
    diagnostics: &Diagnostics,
    slave: usize,
    settings: &SlaveSettings,
) -> Option<Error> {
    let capacity = Capacity::new(settings.rx_multiplier, settings.tx_multiplier);
    let sizes = [(Direction::RxPdo, capacity.rx_bytes), (Direction::TxPdo, capacity.tx_bytes)];
    let fits = sizes
        .map(|(direction, bytes)| StartupStep::expect(direction.profile_object(), 9, bytes as u32));
    let steps = [startup_list(settings), fits.to_vec()].concat();
    run_steps(diagnostics, slave, &steps).err()
}
