//! Waiting for OP while process data run, and the report when a slave does not get there.

use std::fmt;

use ecan_protocol::{AlState, AlStatusCode};
use ecrt_sys::{RequestState, SlaveConfigState};

use crate::adapter::{Adapter, Phase};
use crate::cycle::CycleError;
use crate::error::{Error, al_state_words};
use crate::startup::startup_list;

/// ESC register of the AL status code.
const AL_STATUS_CODE_REGISTER: u16 = 0x0134;
/// How often slow state is asked for while waiting, in nanoseconds.
const INSPECT_NS: u64 = 200_000_000;
/// How long the AL status code is waited for, in nanoseconds.
const AL_STATUS_NS: u64 = 500_000_000;

/// A startup SDO that the slave refuses.
#[derive(Debug)]
pub struct FailedSdo(pub Box<Error>);

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
    /// Why, in the slave's words; `None` when it could not be read.
    pub al_status_code: Option<AlStatusCode>,
    /// The startup step that fails, when the slave hangs in PREOP because of one.
    pub failed_sdo: Option<FailedSdo>,
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
        if let Some(code) = self.al_status_code.filter(|code| code.0 != 0) {
            write!(f, ", AL status code {code}")?;
        }
        if let Some(FailedSdo(error)) = &self.failed_sdo {
            write!(f, ", because {error}")?;
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
            let now = clock.now_ns();
            let stuck = now >= inspect && self.a_slave_is_stuck();
            if stuck || now >= deadline {
                let report = self.not_operational((now - start) / 1_000_000, &mut cycle)?;
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
            if state.operational && self.domain_report(slave).is_complete() {
                continue;
            }
            slaves.push(self.slave_report(slave, state, cycle)?);
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
        let al_state =
            info.as_ref().map(|info| info.al_state).or(state.online.then_some(state.al_state));
        let error_flag = info.as_ref().is_some_and(|info| info.error_flag);
        let al_status_code =
            if state.online { self.read_al_status_code(slave, cycle)? } else { None };
        let failed_sdo = if state.online && al_state.is_some_and(is_preop) {
            let steps = startup_list(&self.config.slaves[slave]);
            self.run_startup(slave, &steps).err().map(|error| FailedSdo(Box::new(error)))
        } else {
            None
        };
        let settings = &self.config.slaves[slave];
        Ok(SlaveReport {
            slave,
            alias: settings.alias,
            position: settings.position,
            online: state.online,
            al_state,
            error_flag,
            al_status_code,
            failed_sdo,
            working_counter: self.domain_report(slave).working_counter,
        })
    }

    /// Reads the AL status code register while the cycle goes on.
    fn read_al_status_code(
        &mut self,
        slave: usize,
        cycle: &mut impl FnMut(&mut Self) -> Result<(), CycleError>,
    ) -> Result<Option<AlStatusCode>, Error> {
        let request = self.slave(slave)?.al_status;
        let call = "ecrt_reg_request_read";
        self.master
            .reg_request_read(request, AL_STATUS_CODE_REGISTER, 2)
            .map_err(|e| Error::library(call, Some(slave), e))?;
        let clock = self.ecrt.clock().clone();
        let mut next = clock.now_ns();
        let deadline = next + AL_STATUS_NS;
        while clock.now_ns() < deadline {
            next += u64::from(self.config.cycle_ns);
            clock.sleep_until_ns(next);
            cycle(self)?;
            match self.master.reg_request_state(request) {
                Ok(RequestState::Success) => {
                    let code = match self.master.reg_request_data(request) {
                        [low, high, ..] => Some(AlStatusCode(u16::from_le_bytes([*low, *high]))),
                        _ => None,
                    };
                    return Ok(code);
                }
                Ok(RequestState::Error) | Err(_) => break,
                Ok(_) => {}
            }
        }
        Ok(None)
    }
}
