//! Why slaves are not in OP, with everything that the master and the gateway can tell.

use std::fmt;

use ecan_protocol::device::{AlState, AlStatusCode, Capabilities};
use ecan_protocol::mapping::Direction;

use crate::adapter::{Adapter, Slave};
use crate::diagnostics::Diagnostics;
use crate::error::{Error, al_state_words};
use crate::startup::StartupStep;

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
    /// Whether the master met an error with the slave and holds it where it is.
    pub error_flag: bool,
    /// Why, in the slave's words: the last code seen while waiting, since the master acknowledges
    /// errors and so clears them. `None` when none was caught.
    pub al_status_code: Option<AlStatusCode>,
    /// What is wrong with a slave that the master holds in PREOP: the startup SDO that it refuses,
    /// or the object that does not fit the configured N.
    pub cause: Option<Box<Error>>,
    /// Working counter of its domain in the last cycle.
    pub working_counter: u32,
    /// Working counter of a complete exchange.
    pub expected_working_counter: u32,
}

impl SlaveReport {
    /// Whether the master has given up in PREOP, so that trying its steps again disturbs nothing.
    fn is_held_in_preop(&self) -> bool {
        self.online && self.error_flag && self.al_state.is_some_and(is_preop)
    }
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
        } else if is_preop(state) {
            f.write_str(", still being configured")?;
        }
        if let Some(code) = self.al_status_code {
            write!(f, ", AL status code {code}")?;
        }
        if let Some(cause) = &self.cause {
            write!(f, ", because {cause}")?;
        }
        let (counter, expected) = (self.working_counter, self.expected_working_counter);
        write!(f, ", working counter {counter} of {expected}")
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

pub(crate) fn is_preop(al_state: u8) -> bool {
    AlState::from_status(al_state.into()) == Some(AlState::PreOp)
}

impl NotOperational {
    /// The blocking transfers that find the causes, for
    /// [`run_in_parallel`](crate::run_in_parallel).
    pub fn investigation(
        &self,
        adapter: &Adapter,
    ) -> impl FnOnce(&Diagnostics) -> Vec<(usize, Error)> + Send + use<> {
        let held = self.slaves.iter().filter(|report| report.is_held_in_preop());
        let work: Vec<(usize, Vec<StartupStep>)> = held
            .filter_map(|report| {
                let slave = adapter.slaves.get(report.slave)?;
                let steps = adapter.startup.steps(&adapter.config, report.slave);
                Some((report.slave, steps_to_try(&steps, slave)))
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

/// The startup steps once more, on the very gateway, and then the sizes that it has active: one
/// that does not fit the process data is answered with AL status 0x001D or 0x001E.
fn steps_to_try(startup: &[StartupStep], slave: &Slave) -> Vec<StartupStep> {
    let layout = slave.layout;
    let same = [(7, slave.serial[0]), (8, slave.serial[1])]
        .map(|(subindex, half)| StartupStep::expect(Capabilities::INDEX, subindex, half));
    let sizes = [(Direction::RxPdo, layout.rx_bytes), (Direction::TxPdo, layout.tx_bytes)]
        .map(|(direction, bytes)| StartupStep::expect(direction.profile_object(), 9, bytes as u32));
    [&same[..], startup, &sizes].concat()
}

impl Adapter {
    /// The slaves that are not in OP now, without what takes blocking transfers.
    ///
    /// # Errors
    /// The library's error.
    pub fn not_operational(&self, waited_ms: u64) -> Result<NotOperational, Error> {
        let mut slaves = Vec::new();
        for (index, slave) in self.slaves.iter().enumerate() {
            let state = self.slave_state(index)?;
            let domain = self.domain_report(index);
            if state.operational && domain.is_complete() {
                continue;
            }
            let info = self.diagnostics.slave_info(index).ok();
            let place = self.config.slaves.get(index);
            slaves.push(SlaveReport {
                slave: index,
                alias: place.map_or(0, |settings| settings.alias),
                position: place.map_or(0, |settings| settings.position),
                online: state.online,
                al_state: info
                    .as_ref()
                    .map(|info| info.al_state)
                    .or(state.online.then_some(state.al_state)),
                error_flag: info.is_some_and(|info| info.error_flag),
                al_status_code: slave.al_status.last(),
                cause: None,
                working_counter: domain.working_counter,
                expected_working_counter: domain.expected_working_counter,
            });
        }
        Ok(NotOperational { waited_ms, slaves })
    }
}
