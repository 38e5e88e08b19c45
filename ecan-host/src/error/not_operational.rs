//! Report of the slaves that are not in OP.

use std::fmt;

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::{Direction, SyncManagerLayout};

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
    /// Whether the master keeps the slave in PREOP, so that executing its steps again has no side effect.
    pub(crate) fn is_held_in_preop(&self) -> bool {
        self.online && self.error_flag && self.al_state.is_some_and(is_preop)
    }

    /// It rejected OP without an error that has another cause than the process data.
    fn may_have_lost_profile(&self) -> bool {
        let is_safeop = |raw: u8| AlState::from_status(raw.into()) == Some(AlState::SafeOp);
        self.error_flag
            && self.al_state.is_some_and(is_safeop)
            && self.may_have_wrong_process_data()
    }

    /// It rejected SAFEOP for the configuration of its clock, or for a reason that was not read.
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
                f.write_str("; repair it with scripts/ecan_sii_sm_layout.sh fix")?;
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
