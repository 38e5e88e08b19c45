//! Parameters that a node gets before it runs: values, and their downloads to one node.

use std::fmt;
use std::sync::Arc;

use ecan_protocol::sequence::SdoValue;
use thiserror::Error;

use crate::network::config::Step;
use crate::network::error::{NodeAccessError, SdoFault, SdoStartError};
use crate::network::sdo::{SdoClient, SdoTurn, TurnState};
use crate::object;

/// Bit of the COB-ID of a PDO.
const NO_RTR: u32 = 1 << 30;

/// One value to write to a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parameter {
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// The value, little-endian, with as many bytes as the object has.
    pub data: Vec<u8>,
    /// Name of the object for messages, as in its device file; may be empty.
    pub name: Arc<str>,
    /// The value is read back after all downloads and must be the same. Not for objects that are
    /// write-only or whose value the node changes.
    pub is_verified: bool,
}

impl Parameter {
    /// A value without a name, which is verified.
    pub fn new((index, subindex): (u16, u8), data: impl Into<Vec<u8>>) -> Self {
        Self { index, subindex, data: data.into(), name: Arc::from(""), is_verified: true }
    }

    /// Returns whether a node that has this value returned `value`.
    pub(super) fn is_confirmed_by(&self, value: &[u8]) -> bool {
        let is_pdo_cob_id = matches!(self.key(), (0x1400..=0x15FF | 0x1800..=0x19FF, 1));
        match (<[u8; 4]>::try_from(&*self.data), <[u8; 4]>::try_from(value)) {
            // Nodes differ in whether bit 30, no remote request, can change.
            (Ok(own), Ok(found)) if is_pdo_cob_id => {
                (u32::from_le_bytes(own) ^ u32::from_le_bytes(found)) & !NO_RTR == 0
            }
            _ => self.data == value,
        }
    }

    pub(in crate::network) fn key(&self) -> (u16, u8) {
        (self.index, self.subindex)
    }

    pub(in crate::network) fn subject(&self) -> Subject {
        let name = (!self.name.is_empty()).then(|| self.name.clone());
        Subject { index: self.index, subindex: self.subindex, name }
    }
}

/// An object in a message: `0x6081:00 (Profile velocity)`. A clone does not allocate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subject {
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// Its name in the device file.
    pub name: Option<Arc<str>>,
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{:02X}", self.index, self.subindex)?;
        let name = match (&self.name, self.index) {
            (Some(name), _) => name,
            (None, object::CONFIGURATION_DATE) => "configuration date",
            (None, object::STORE_PARAMETERS) => "save parameters",
            (None, _) => return Ok(()),
        };
        write!(f, " ({name})")
    }
}

/// Date and time of a configuration, as object 0x1020 keeps them (CiA 301, 7.5.2.19).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConfigurationDate {
    /// Days since 1984-01-01.
    pub days: u32,
    /// Milliseconds after midnight.
    pub milliseconds: u32,
}

/// Configuration of one node by SDO: plain data.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ParameterSet {
    /// Values, written in this order.
    pub parameters: Vec<Parameter>,
    /// A node whose 0x1020 has this date and time has the configuration already: nothing is written.
    /// It is written to 0x1020 after the downloads.
    pub date: Option<ConfigurationDate>,
    /// Saves the parameters in the node (0x1010:01) after the downloads.
    pub saves: bool,
}

impl ParameterSet {
    /// The writes after those of the values: date and command to save.
    pub(super) fn closing_steps(&self) -> Vec<Step> {
        let mut steps = Vec::new();
        if let Some(ConfigurationDate { days, milliseconds }) = self.date {
            let writes = [(DAYS, days), (MILLISECONDS, milliseconds)];
            let step = |((index, subindex), value)| Step::write(index, subindex, value);
            steps.extend(writes.map(step).map(|step: Step| step.named("configuration date")));
        }
        if self.saves {
            let (index, subindex) = SAVE_ALL;
            steps.push(Step::write(index, subindex, u32::from_le_bytes(SAVE)).named("save"));
        }
        steps
    }
}

/// Failure to write a [`ParameterSet`](super::ParameterSet).
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ParameterError {
    /// A transfer failed.
    #[error("{}: {fault}", text(subject))]
    Transfer {
        /// The object.
        subject: Option<Subject>,
        /// Cause.
        fault: SdoFault,
    },
    /// A transfer could not start.
    #[error("{}: {error}", text(subject))]
    Start {
        /// The object.
        subject: Option<Subject>,
        /// Cause.
        error: SdoStartError,
    },
    /// The node has another value than the one that was written.
    #[error("{subject} = {expected} was written, {found} read back")]
    Mismatch {
        /// The object.
        subject: Subject,
        /// Value that was read back; the first bytes of a long one.
        found: SdoValue,
        /// Value that was written; the first bytes of a long one.
        expected: SdoValue,
    },
}

fn text(subject: &Option<Subject>) -> String {
    subject.as_ref().map_or_else(|| "object".to_owned(), ToString::to_string)
}

impl From<ParameterError> for NodeAccessError {
    fn from(error: ParameterError) -> Self {
        match error {
            ParameterError::Transfer { subject: Some(subject), fault } => {
                Self::Parameter { index: subject.index, subindex: subject.subindex, fault }
            }
            ParameterError::Transfer { subject: None, fault } => fault.into(),
            ParameterError::Start { error, .. } => error.into(),
            ParameterError::Mismatch { subject, found, expected } => {
                let (index, subindex) = (subject.index, subject.subindex);
                Self::ParameterMismatch { index, subindex, found, expected }
            }
        }
    }
}

const SAVE: [u8; 4] = *b"save";
const SAVE_ALL: (u16, u8) = (object::STORE_PARAMETERS, 1);
const DAYS: (u16, u8) = (object::CONFIGURATION_DATE, 1);
const MILLISECONDS: (u16, u8) = (object::CONFIGURATION_DATE, 2);

/// State of a [`ParameterDownload`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::network) enum ParameterState {
    Running,
    /// The node had the configuration already.
    Unchanged,
    Written,
    Failed(ParameterError),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    ReadDays,
    ReadMilliseconds,
    Write(usize),
    ReadBack(usize),
    WriteDays,
    WriteMilliseconds,
    Save,
    Unchanged,
    Written,
}

/// Writes a parameter set to a node, one transfer after the other: reads its configuration date,
/// writes and reads back the values, writes the date, saves. Real-time safe.
#[derive(Debug)]
pub(in crate::network) struct ParameterDownload {
    set: Arc<ParameterSet>,
    stage: Stage,
    turn: SdoTurn,
    is_transferring: bool,
}

impl ParameterDownload {
    pub(in crate::network) fn new(set: Arc<ParameterSet>) -> Self {
        let stage = first_stage(&set);
        Self { set, stage, turn: SdoTurn::default(), is_transferring: false }
    }

    /// Starts over at the first transfer.
    pub(in crate::network) fn restart(&mut self) {
        self.stage = first_stage(&self.set);
        self.is_transferring = false;
    }

    /// Complete values and all values; both are 0 for an empty set.
    pub(super) fn progress(&self) -> (usize, usize) {
        let of = self.set.parameters.len();
        let done = match self.stage {
            Stage::ReadDays | Stage::ReadMilliseconds => 0,
            Stage::Write(nth) => nth,
            _ => of,
        };
        (done, of)
    }

    /// Object of the present transfer.
    pub(super) fn subject(&self) -> Option<Subject> {
        let own = |(index, subindex): (u16, u8)| Some(Subject { index, subindex, name: None });
        match self.stage {
            Stage::Write(nth) | Stage::ReadBack(nth) => {
                self.set.parameters.get(nth).map(Parameter::subject)
            }
            Stage::ReadDays | Stage::WriteDays => own(DAYS),
            Stage::ReadMilliseconds | Stage::WriteMilliseconds => own(MILLISECONDS),
            Stage::Save => own(SAVE_ALL),
            Stage::Unchanged | Stage::Written => None,
        }
    }

    pub(super) fn cancel(&self, client: &mut SdoClient) {
        if self.is_transferring {
            client.cancel();
        }
    }

    /// Executes transfers until one must wait. Call once per cycle.
    pub(in crate::network) fn advance(&mut self, client: &mut SdoClient) -> ParameterState {
        loop {
            match self.stage {
                Stage::Unchanged => return ParameterState::Unchanged,
                Stage::Written => return ParameterState::Written,
                _ => {}
            }
            if !self.is_transferring {
                match self.start(client) {
                    Some(Ok(true)) => self.is_transferring = true,
                    Some(Ok(false)) => return ParameterState::Running,
                    Some(Err(error)) => return ParameterState::Failed(error),
                    None => {
                        self.stage = self.next();
                        continue;
                    }
                }
            }
            let state = self.turn.poll(client);
            if state == TurnState::Busy {
                return ParameterState::Running;
            }
            self.is_transferring = false;
            let result = match state {
                TurnState::Failed(fault) => self.after_failure(fault),
                TurnState::Done => self.after_success(client.data()),
                TurnState::Busy | TurnState::Lost => Ok(self.stage),
            };
            match result {
                Ok(stage) => self.stage = stage,
                Err(error) => return ParameterState::Failed(error),
            }
        }
    }

    /// Starts the transfer of the stage; `None` if there is none. Returns `false` if the client is
    /// busy.
    fn start(&mut self, client: &mut SdoClient) -> Option<Result<bool, ParameterError>> {
        let Self { set, turn, .. } = self;
        let date = set.date.unwrap_or(ConfigurationDate { days: 0, milliseconds: 0 });
        let started = match self.stage {
            Stage::Unchanged | Stage::Written => return None,
            Stage::ReadDays => turn.upload(client, DAYS),
            Stage::ReadMilliseconds => turn.upload(client, MILLISECONDS),
            Stage::WriteDays => turn.download(client, DAYS, &date.days.to_le_bytes()),
            Stage::WriteMilliseconds => {
                let data = date.milliseconds.to_le_bytes();
                turn.download(client, MILLISECONDS, &data)
            }
            Stage::Save => turn.download(client, SAVE_ALL, &SAVE),
            Stage::Write(nth) => {
                let download = set.parameters.get(nth)?;
                turn.download(client, download.key(), &download.data)
            }
            Stage::ReadBack(nth) => {
                let download = set.parameters.get(nth).filter(|parameter| parameter.is_verified)?;
                turn.upload(client, download.key())
            }
        };
        Some(started.map_err(|error| ParameterError::Start { subject: self.subject(), error }))
    }

    /// The stage after the present one.
    fn next(&self) -> Stage {
        let has = |nth: usize| nth < self.set.parameters.len();
        let after_values = match self.set.date {
            Some(_) => Stage::WriteDays,
            None => self.after_date(),
        };
        match self.stage {
            Stage::ReadDays => Stage::ReadMilliseconds,
            Stage::ReadMilliseconds => Stage::Unchanged,
            Stage::Write(nth) if has(nth + 1) => Stage::Write(nth + 1),
            Stage::Write(_) if has(0) => Stage::ReadBack(0),
            Stage::ReadBack(nth) if has(nth + 1) => Stage::ReadBack(nth + 1),
            Stage::Write(_) | Stage::ReadBack(_) => after_values,
            Stage::WriteDays => Stage::WriteMilliseconds,
            Stage::WriteMilliseconds => self.after_date(),
            Stage::Save => Stage::Written,
            end @ (Stage::Unchanged | Stage::Written) => end,
        }
    }

    fn after_date(&self) -> Stage {
        if self.set.saves { Stage::Save } else { Stage::Written }
    }

    /// The stage that follows the successful transfer of the present one.
    fn after_success(&self, value: &[u8]) -> Result<Stage, ParameterError> {
        let is = |expected: Option<u32>| {
            expected.is_some_and(|number| SdoValue::from_bytes(value).raw() == u64::from(number))
        };
        match self.stage {
            Stage::ReadDays if !is(self.set.date.map(|date| date.days)) => Ok(Stage::Write(0)),
            Stage::ReadMilliseconds if !is(self.set.date.map(|date| date.milliseconds)) => {
                Ok(Stage::Write(0))
            }
            Stage::ReadBack(nth) => match self.set.parameters.get(nth) {
                Some(download) if !download.is_confirmed_by(value) => {
                    Err(ParameterError::Mismatch {
                        subject: download.subject(),
                        found: SdoValue::from_bytes(value),
                        expected: SdoValue::from_bytes(&download.data),
                    })
                }
                _ => Ok(self.next()),
            },
            _ => Ok(self.next()),
        }
    }

    /// The stage that follows the failed transfer of the present one. A node without 0x1020 has no configuration
    /// date.
    fn after_failure(&self, fault: SdoFault) -> Result<Stage, ParameterError> {
        match (self.stage, fault) {
            (Stage::ReadDays | Stage::ReadMilliseconds, SdoFault::Aborted(_)) => {
                Ok(Stage::Write(0))
            }
            _ => Err(ParameterError::Transfer { subject: self.subject(), fault }),
        }
    }
}

fn first_stage(set: &ParameterSet) -> Stage {
    if set.date.is_some() { Stage::ReadDays } else { Stage::Write(0) }
}
