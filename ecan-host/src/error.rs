//! Errors of the Adapter, with the fields that locate them.

use std::fmt;
use std::time::Duration;

use ecan_protocol::device::{AlState, AlStatusCode, Recognition, assumed_value};
use ecan_protocol::mapping::{Direction, SyncManagerLayout};
use ecan_protocol::object::{AbortCode, describe};
use ecan_protocol::sequence::Expectation;
use ecrt_sys::Errno;
use thiserror::Error;
use tracing::debug;

use crate::config::{Faults, Identity};
use crate::config_check::ConfigFault;
use crate::exchange::{CycleError, Phase};
use crate::master::OpenError;
use crate::sdo_text::{contradicted_assumption, expected_text, is_missing, sdo_cause, value_text};

/// Direction of an SDO transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SdoDirection {
    /// From the slave.
    Upload,
    /// To the slave.
    Download,
}

impl SdoDirection {
    /// Noun and preposition.
    fn text(self) -> (&'static str, &'static str) {
        match self {
            Self::Upload => ("upload", "from"),
            Self::Download => ("download", "to"),
        }
    }
}

/// Errors of the Adapter outside the cycle.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// The configuration has faults; nothing was changed.
    #[error(transparent)]
    Config(#[from] Faults<ConfigFault>),
    /// The master could not be requested or opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A call of the master library failed.
    #[error("{call}{} failed: {errno}", for_slave(*slave))]
    Library {
        /// Name of the library function.
        call: &'static str,
        /// Slave index, if the call concerns one slave.
        slave: Option<usize>,
        /// Error number of the system.
        errno: Errno,
    },
    /// The network interface of the master has no link.
    #[error(
        "the network interface of the EtherCAT master has no link; check the cable and the supply of \
         the first slave"
    )]
    NoLink,
    /// The network interface has a link, but no slave responds.
    #[error(
        "no slave responds on the bus; check supply and cabling (port IN of the first slave), and \
         that the interface of the master is the one of the bus"
    )]
    NoSlaves,
    /// No slave at the configured address.
    #[error(
        "slave {slave} (alias {alias}, position {position}) is not on the bus: {}",
        match (is_scanning, responding) {
            (true, _) => "the master is still scanning it".to_owned(),
            (false, 0) => Self::NoSlaves.to_string(),
            (false, _) => format!(
                "{responding} slave(s) found; check supply and cabling, and `ecan scan`"
            ),
        }
    )]
    NoSuchSlave {
        /// Slave index.
        slave: usize,
        /// Configured alias.
        alias: u16,
        /// Configured position.
        position: u16,
        /// Number of slaves that the master found.
        responding: u32,
        /// True if the master is still scanning the bus.
        is_scanning: bool,
    },
    /// Two configured slaves are the same slave on the bus.
    #[error("slaves {first} and {second} are the same slave, at position {position}")]
    SameSlave {
        /// Index of the first.
        first: usize,
        /// Index of the second.
        second: usize,
        /// Their position on the bus.
        position: u16,
    },
    /// A reconfiguration with another master than the reserved one.
    #[error(
        "the Adapter has reserved master {is} and cannot change to master {configured}; open a new Adapter"
    )]
    OtherMaster {
        /// The master in use.
        is: u32,
        /// The configured master.
        configured: u32,
    },
    /// The handle given to attach is not the handle of another owner.
    #[error("attach needs the handle of a master that its owner drives (Master::from_raw)")]
    OwnedMaster,
    /// The call is only for an attached Adapter.
    #[error("{call} is only for an Adapter that is attached to an owner's master")]
    NotAttached {
        /// The call.
        call: &'static str,
    },
    /// The slave has another identity than the configured one.
    #[error("slave {slave}: identity {found} does not match the configured {expected}")]
    IdentityMismatch {
        /// Slave index.
        slave: usize,
        /// Configured identity.
        expected: Identity,
        /// Identity on the bus.
        found: Identity,
    },
    /// The slave is not an ECAN-Lite.
    #[error(
        "slave {slave} is not an ECAN-Lite: 0xF000 has header versions 0x{:04X}, PDO unit {} bytes, \
         header {} bytes; an ECAN-Lite has 0x0002, 128 and 24",
        found.header_version_mask, found.size_unit_bytes, found.header_bytes
    )]
    NotAnEcanLite {
        /// Slave index.
        slave: usize,
        /// Values of its 0xF000.
        found: Recognition,
    },
    /// The slave cannot be identified.
    #[error(
        "slave {slave} cannot be identified as an ECAN-Lite: {cause}{}",
        match cause.as_ref() {
            cause if cause.is_missing_object() => ", or it is none (assumption H1)",
            cause if cause.lacks_coe() => {
                "; it has no mailbox with CoE: configure the alias and the position of an ECAN-Lite"
            }
            _ => "",
        }
    )]
    Unrecognised {
        /// Slave index.
        slave: usize,
        /// Error of reading 0xF000.
        #[source]
        cause: Box<Error>,
    },
    /// The PDO chunks of the slave differ from the manual's (5.1).
    #[error(
        "slave {slave}: PDO 0x{pdo:04X} entry {entry} maps object 0x{found_index:04X} with \
         {found_bits} bits, expected 0x{expected_index:04X} with 128 bits (manual 5.1.1)"
    )]
    Mapping {
        /// Slave index.
        slave: usize,
        /// PDO map object, 0x1600.. or 0x1A00...
        pdo: u16,
        /// Entry subindex, from 1.
        entry: u8,
        /// Object that the slave maps.
        found_index: u16,
        /// Length of the object in bits.
        found_bits: u8,
        /// Object that the manual maps.
        expected_index: u16,
    },
    /// The number of entries of a PDO differs from the manual's 8 (5.1).
    #[error("slave {slave}: PDO 0x{pdo:04X} has {found} entries, expected 8 (manual 5.1.1)")]
    MappingCount {
        /// Slave index.
        slave: usize,
        /// PDO map object.
        pdo: u16,
        /// Entries that it has.
        found: u32,
    },
    /// The chunks are not continuous in the domain.
    #[error(
        "slave {slave}: the master placed object 0x{index:04X} at domain offset {found}, \
         expected {expected}: the chunks are not continuous"
    )]
    Layout {
        /// Slave index.
        slave: usize,
        /// Data object.
        index: u16,
        /// Offset from the master.
        found: usize,
        /// Offset in a continuous image.
        expected: usize,
    },
    /// The slave does not reach PREOP, so that it cannot be configured.
    #[error(
        "slave {slave} did not reach PREOP within {} ms: it is in {}{}", timeout.as_millis(),
        al_state_text(*al_state), if *error_flag { " with its error flag set" } else { "" }
    )]
    NotInPreop {
        /// Slave index.
        slave: usize,
        /// AL state of the slave as a number.
        al_state: u8,
        /// True if its error flag is set.
        error_flag: bool,
        /// Time waited.
        timeout: Duration,
    },
    /// An SDO transfer failed.
    #[error(
        "SDO {} {} {} slave {slave} {}", direction.text().0, describe(*index, *subindex),
        direction.text().1, sdo_cause((*index, *subindex), *abort_code, *errno, *attempts)
    )]
    Sdo {
        /// Slave index.
        slave: usize,
        /// Direction.
        direction: SdoDirection,
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Error number of the system.
        errno: Errno,
        /// Abort code of the slave, if it answered.
        abort_code: Option<AbortCode>,
        /// Number of attempts.
        attempts: u32,
    },
    /// An object does not have the expected value.
    #[error(
        "{} of slave {slave} reads {}, expected {}{}",
        describe(*index, *subindex),
        value_text(*index, *subindex, *found),
        expected_text(*index, *subindex, *expected),
        contradicted_assumption(*index, *subindex, *found)
    )]
    Readback {
        /// Slave index.
        slave: usize,
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Expected value.
        expected: Expectation,
        /// Value of the object.
        found: u32,
    },
    /// Not every slave reached OP in time.
    #[error(transparent)]
    NotOperational(Box<NotOperational>),
    /// The call is not possible in the current phase.
    #[error("{call} needs the Adapter {needed}, it is {is}")]
    Phase {
        /// The call.
        call: &'static str,
        /// Required phase.
        needed: Phase,
        /// Current phase.
        is: Phase,
    },
    /// The call is only for the owner of the master that the Adapter is attached to.
    #[error("{call} is not available on an attached Adapter; the owner of the master must call it")]
    Attached {
        /// The call.
        call: &'static str,
    },
    /// A slave index out of range.
    #[error("slave index {slave} is out of range: {count} slave(s) are configured")]
    SlaveIndex {
        /// The index.
        slave: usize,
        /// Number of configured slaves.
        count: usize,
    },
    /// The program through which the bus is accessed rejects the call.
    #[error("{reason}")]
    NotPermitted {
        /// The call, the program, and what to do.
        reason: String,
    },
    /// The program through which the bus is accessed ended, or its connection failed.
    #[error("{reason}")]
    Disconnected {
        /// The program and the cause.
        reason: String,
    },
    /// The application ended the wait, see
    /// [`Adapter::stop_waiting_when`](crate::Adapter::stop_waiting_when).
    #[error("cancelled by the application")]
    Stopped,
    /// The host denied the thread of the requests beside the cycle.
    #[error(
        "cannot start a thread for requests beside the cycle: {errno}; raise the limits of this user or service \
         (ulimit -u, TasksMax)"
    )]
    Thread {
        /// Error of the system.
        errno: Errno,
    },
    /// The cycle failed while waiting.
    #[error(transparent)]
    Cycle(#[from] CycleError),
}

impl Error {
    /// Returns whether the cause may pass without a change by the application, so that the same call can
    /// succeed later: the slaves are not ready, an SDO transfer got no answer, the master is busy.
    pub fn is_temporary(&self) -> bool {
        match self {
            error if error.lacks_coe() => false,
            Self::NoLink
            | Self::NoSlaves
            | Self::NoSuchSlave { .. }
            | Self::NotInPreop { .. }
            | Self::NotOperational(_)
            | Self::Thread { .. }
            | Self::Sdo { abort_code: None, .. } => true,
            Self::Open(error) => error.is_temporary(),
            Self::Unrecognised { cause, .. } => cause.is_temporary(),
            Self::Cycle(error) => error.is_temporary(),
            _ => false,
        }
    }

    /// Returns whether the slave rejected an SDO transfer because it does not have the object or the entry.
    pub fn is_missing_object(&self) -> bool {
        matches!(self, Self::Sdo { abort_code: Some(code), .. } if is_missing(*code))
    }

    /// Returns whether an SDO transfer failed because the slave has no mailbox with CoE by its SII: it is
    /// another device.
    pub fn lacks_coe(&self) -> bool {
        matches!(self, Self::Sdo { errno: Errno::EPROTONOSUPPORT, .. })
    }

    /// The value of an uploaded entry, or the one that is
    /// [assumed](ecan_protocol::device::assumed_value) if the slave does not have the entry.
    ///
    /// # Errors
    /// The error of the upload otherwise.
    pub fn or_assumed(value: Result<u32, Self>, index: u16, subindex: u8) -> Result<u32, Self> {
        match value {
            Err(error) if error.is_missing_object() => assumed_value(index, subindex).ok_or(error),
            value => value,
        }
    }

    pub(crate) fn library(call: &'static str, slave: Option<usize>, errno: Errno) -> Self {
        Self::Library { call, slave, errno }
    }

    /// Names the slave by its index instead of its position, and sets the number of attempts.
    pub(crate) fn of_slave(mut self, at: usize, count: u32) -> Self {
        match &mut self {
            Self::Sdo { slave, attempts, .. } => (*slave, *attempts) = (at, count),
            Self::Library { slave: Some(slave), .. } | Self::NoSuchSlave { slave, .. } => {
                *slave = at;
            }
            _ => {}
        }
        if let Self::Sdo { slave, index, subindex, .. } = self {
            debug!(slave, index, subindex, "{self}");
        }
        self
    }
}

/// An AL state by name, or as a number.
impl Phase {
    /// Rejects a call that needs another phase.
    pub(crate) fn need(self, call: &'static str, needed: Self) -> Result<(), Error> {
        if self == needed { Ok(()) } else { Err(Error::Phase { call, needed, is: self }) }
    }
}

pub(crate) fn al_state_text(raw: u8) -> String {
    AlState::from_status(raw.into())
        .map_or_else(|| format!("state {raw}"), |state| state.to_string())
}

fn for_slave(slave: Option<usize>) -> String {
    slave.map_or_else(String::new, |s| format!(" for slave {s}"))
}

/// State of a slave that is not in OP.
#[derive(Debug)]
pub struct SlaveReport {
    /// Slave index.
    pub slave: usize,
    /// Configured alias.
    pub alias: u16,
    /// Configured position.
    pub position: u16,
    /// Index of its master.
    pub master_index: u32,
    /// Position on the bus, from 0, as IgH's command line tool counts; `None` when the slave does not
    /// answer.
    pub ring_position: Option<u16>,
    /// True if the slave responds.
    pub online: bool,
    /// AL state as a number; `None` when the slave does not answer.
    pub al_state: Option<u8>,
    /// True if the master met an error with the slave and keeps it in its state.
    pub error_flag: bool,
    /// True if the master met an error with the slave in an earlier attempt of this wait and kept it in
    /// PREOP.
    pub was_held: bool,
    /// The last AL status code seen while waiting, because the master acknowledges
    /// errors and so clears them. `None` when none was caught.
    pub al_status_code: Option<AlStatusCode>,
    /// SM2 and SM3 as the master configured them, read while waiting; `None` when they were not
    /// configured or not read.
    pub sync_managers: Option<[SyncManagerLayout; 2]>,
    /// True if the configuration has distributed clocks.
    pub uses_sync0: bool,
    /// Cause of a slave that the master keeps in PREOP: the startup SDO that it aborts,
    /// or the object that does not fit the configured N.
    pub cause: Option<Box<Error>>,
    /// Working counter of its domain in the last cycle.
    pub working_counter: u32,
    /// Working counter of a complete exchange.
    pub expected_working_counter: u32,
}

impl SlaveReport {
    /// Returns whether the master keeps the slave in PREOP, so that executing its steps again has no side effect.
    pub(crate) fn is_held_in_preop(&self) -> bool {
        self.online && self.error_flag && self.al_state.is_some_and(is_preop)
    }

    /// Returns whether the slave rejected OP without an error that has another cause than the process data.
    fn may_have_lost_profile(&self) -> bool {
        let is_safeop = |raw: u8| AlState::from_status(raw.into()) == Some(AlState::SafeOp);
        self.error_flag
            && self.al_state.is_some_and(is_safeop)
            && self.may_have_wrong_process_data()
    }

    /// Returns whether the slave rejected SAFEOP for the configuration of its clock, or for a reason that was
    /// not read.
    fn may_need_other_activation(&self) -> bool {
        self.uses_sync0
            && self.wrong_sync_managers().next().is_none()
            && match self.al_status_code {
                Some(code) => code == AlStatusCode::DC_CONFIGURATION,
                None => self.error_flag || self.was_held,
            }
    }

    fn may_have_wrong_process_data(&self) -> bool {
        self.al_status_code.is_none_or(is_of_process_data)
    }

    /// SM2 and SM3 that are not those of manual 5.3, each as a text.
    fn wrong_sync_managers(&self) -> impl Iterator<Item = String> {
        let managers = self.sync_managers.into_iter().flatten();
        let wrong = |(found, (name, direction)): (SyncManagerLayout, (&str, Direction))| {
            let required = SyncManagerLayout::required(direction);
            let required = SyncManagerLayout { length: found.length, ..required };
            (!found.has_required_start_and_control(direction))
                .then(|| format!("{name} has {found} instead of {required}"))
        };
        managers.zip([("SM2", Direction::RxPdo), ("SM3", Direction::TxPdo)]).filter_map(wrong)
    }

    /// The check of manual 16.1 for a slave that rejects its process data in PREOP.
    fn write_sync_manager_check(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let wrong: Vec<String> = self.wrong_sync_managers().collect();
        if !wrong.is_empty() {
            write!(f, " ({}: the SII is wrong, manual 15.7, 16.1", wrong.join("; "))?;
            if let Some(position) = self.ring_position {
                f.write_str("; repair it with ecan_sii_sm_layout.sh fix")?;
                if self.master_index != 0 {
                    write!(f, " --master {}", self.master_index)?;
                }
                write!(f, " --position {position}, then power-cycle the gateway")?;
            }
            return f.write_str(")");
        }
        if !self.may_have_wrong_process_data() {
            return Ok(());
        }
        f.write_str(
            " (manual 16.1: compare the numbers of chunks in 0x1C12 and 0x1C13 with N of 0x8010 and 0x8011; \
             `ecan doctor` checks SM2 and SM3 of the SII)",
        )
    }

    /// The cause of its failed startup SDO may be gone: it did not answer in time.
    pub(crate) fn is_temporary(&self) -> bool {
        self.cause.as_ref().is_none_or(|cause| cause.is_temporary())
            && self.wrong_sync_managers().next().is_none()
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
        } else if is_preop(state) {
            if self.error_flag {
                self.write_sync_manager_check(f)?;
            }
            // During another attempt of the master the error flag is clear.
            if self.may_need_other_activation() {
                f.write_str(
                    " (assumption H2: distributed clocks may need another AssignActivate word than 0x0300; its ESI \
                     file has the word, `assign_activate` of the configuration sets it)",
                )?;
            }
        }
        let (counter, expected) = (self.working_counter, self.expected_working_counter);
        write!(f, ", working counter {counter} of {expected}")
    }
}

/// The slaves that did not reach OP in time.
#[derive(Debug, thiserror::Error)]
#[error(
    "not in OP after {waited_ms} ms{}", slaves.iter().map(|slave| format!("\n  - {slave}")).collect::<String>()
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

fn is_of_process_data(code: AlStatusCode) -> bool {
    [AlStatusCode::OUTPUT_CONFIGURATION, AlStatusCode::INPUT_CONFIGURATION].contains(&code)
}

pub(crate) fn is_preop(al_state: u8) -> bool {
    AlState::from_status(al_state.into()) == Some(AlState::PreOp)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slave in PREOP with distributed clocks.
    fn report(error_flag: bool, code: Option<AlStatusCode>) -> SlaveReport {
        SlaveReport {
            slave: 0,
            alias: 77,
            position: 0,
            master_index: 0,
            ring_position: Some(3),
            online: true,
            al_state: Some(2),
            error_flag,
            was_held: false,
            al_status_code: code,
            sync_managers: None,
            uses_sync0: true,
            cause: None,
            working_counter: 0,
            expected_working_counter: 3,
        }
    }

    #[test]
    fn hints_in_preop_depend_on_code_and_error_flag() {
        for (error_flag, code, chunks, activation) in [
            (false, None, false, false),
            (true, None, true, true),
            (true, Some(AlStatusCode::OUTPUT_CONFIGURATION), true, false),
            (true, Some(AlStatusCode::INPUT_CONFIGURATION), true, false),
            (true, Some(AlStatusCode::DC_CONFIGURATION), false, true),
            (false, Some(AlStatusCode::DC_CONFIGURATION), false, true),
            (true, Some(AlStatusCode(0x0016)), false, false),
        ] {
            let text = report(error_flag, code).to_string();
            assert_eq!(text.contains("numbers of chunks"), chunks, "{text}");
            assert_eq!(text.contains("assumption H2:"), activation, "{text}");
        }
    }

    #[test]
    fn hint_about_clocks_is_kept_during_another_attempt() {
        let again = |code| SlaveReport { was_held: true, ..report(false, code) }.to_string();
        let text = again(None);
        assert!(text.contains("still being configured (assumption H2:"), "{text}");
        let text = again(Some(AlStatusCode(0x0016)));
        assert!(!text.contains("assumption H2:"), "{text}");
    }

    #[test]
    fn repair_of_the_sii_needs_the_ring_position() {
        let wrong = SyncManagerLayout::from_bytes([0; SyncManagerLayout::BYTES]);
        let mut report = report(true, None);
        report.sync_managers = Some([wrong; 2]);
        report.master_index = 1;
        let text = report.to_string();
        let command = "fix --master 1 --position 3, then power-cycle the gateway)";
        assert!(text.contains(command), "{text}");
        report.ring_position = None;
        let text = report.to_string();
        assert!(text.contains("the SII is wrong") && !text.contains("fix"), "{text}");
    }
}
