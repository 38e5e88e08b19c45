//! Report of the slaves that are not in OP.

use std::fmt;

use ecan_protocol::device::{AlState, AlStatusCode};

use super::{Error, al_state_text};

/// State of a slave that is not in OP.
#[derive(Debug)]
pub struct SlaveReport {
    /// Slave index.
    pub slave: usize,
    /// Configured alias.
    pub alias: u16,
    /// Configured position.
    pub position: u16,
    /// Whether the slave responds.
    pub online: bool,
    /// AL state as a number; `None` when the slave does not answer.
    pub al_state: Option<u8>,
    /// Whether the master met an error with the slave and keeps it in its state.
    pub error_flag: bool,
    /// The last AL status code seen while waiting, because the master acknowledges
    /// errors and so clears them. `None` when none was caught.
    pub al_status_code: Option<AlStatusCode>,
    /// Cause of a slave that the master keeps in PREOP: the startup SDO that it aborts,
    /// or the object that does not fit the configured N.
    pub cause: Option<Box<Error>>,
    /// Working counter of its domain in the last cycle.
    pub working_counter: u32,
    /// Working counter of a complete exchange.
    pub expected_working_counter: u32,
}

impl SlaveReport {
    /// Whether the master keeps the slave in PREOP, so that executing its steps again has no side effect.
    pub(crate) fn is_held_in_preop(&self) -> bool {
        self.online && self.error_flag && self.al_state.is_some_and(is_preop)
    }

    /// It rejected OP without an error that has another cause than the process data.
    fn may_have_lost_profile(&self) -> bool {
        let is_safeop = |raw: u8| AlState::from_status(raw.into()) == Some(AlState::SafeOp);
        let is_of_profile = |code| {
            [AlStatusCode::OUTPUT_CONFIGURATION, AlStatusCode::INPUT_CONFIGURATION].contains(&code)
        };
        self.error_flag
            && self.al_state.is_some_and(is_safeop)
            && self.al_status_code.is_none_or(is_of_profile)
    }

    /// The cause of its failed startup SDO may be gone: it did not answer in time.
    pub(crate) fn is_temporary(&self) -> bool {
        self.cause.as_ref().is_none_or(|cause| cause.is_temporary())
    }
}

impl fmt::Display for SlaveReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "slave {} (alias {}, position {})", self.slave, self.alias, self.position)?;
        let Some(state) = self.al_state.filter(|_| self.online) else {
            return f.write_str(" does not answer: check its power and the cable to it");
        };
        write!(f, " is in {}", al_state_text(state))?;
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
            if cause.is_missing_object() {
                f.write_str("; update the firmware, or leave out what needs it")?;
            }
        } else if self.may_have_lost_profile() {
            f.write_str(
                " (assumption H41: it may have lost its PDO profile when the master rewrote the PDO assignment; \
                 0x8010:02 and 0x8011:02 then read 5, and writing 1 to 0x8010:01 and 0x8011:01 in SAFEOP applies it \
                 again)",
            )?;
        }
        let (counter, expected) = (self.working_counter, self.expected_working_counter);
        write!(f, ", working counter {counter} of {expected}")
    }
}

/// The slaves that did not reach OP in time.
#[derive(Debug, thiserror::Error)]
#[error(
    "not in OP after {waited_ms} ms{}", slaves.iter().map(|it| format!("\n  - {it}")).collect::<String>()
)]
pub struct NotOperational {
    /// Time waited, in milliseconds.
    pub waited_ms: u64,
    /// Every slave that is not in OP.
    pub slaves: Vec<SlaveReport>,
}

impl NotOperational {
    /// The slaves that the master keeps in PREOP.
    pub(crate) fn held(&self) -> impl Iterator<Item = &SlaveReport> {
        self.slaves.iter().filter(|slave| slave.is_held_in_preop())
    }
}

pub(crate) fn is_preop(al_state: u8) -> bool {
    AlState::from_status(al_state.into()) == Some(AlState::PreOp)
}
