//! Execution of a parameter set on one node.

use std::sync::Arc;

use ecan_protocol::sequence::SdoValue;

use super::parameter::{ConfigurationDate, Parameter, ParameterSet, Subject};
use super::parameter_error::ParameterError;
use crate::network::address::NodeHandle;
use crate::network::network::Network;
use crate::network::sdo_error::SdoFault;
use crate::network::sdo_turn::{SdoTurn, TurnState};
use crate::object;

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

    pub(super) fn cancel(&self, network: &mut Network, handle: NodeHandle) {
        if self.is_transferring {
            network.cancel_sdo(handle);
        }
    }

    /// Executes transfers until one must wait. Call once per cycle.
    pub(in crate::network) fn advance(
        &mut self,
        network: &mut Network,
        handle: NodeHandle,
    ) -> ParameterState {
        loop {
            match self.stage {
                Stage::Unchanged => return ParameterState::Unchanged,
                Stage::Written => return ParameterState::Written,
                _ => {}
            }
            if !self.is_transferring {
                match self.start(network, handle) {
                    Some(Ok(true)) => self.is_transferring = true,
                    Some(Ok(false)) => return ParameterState::Running,
                    Some(Err(error)) => return ParameterState::Failed(error),
                    None => {
                        self.stage = self.next();
                        continue;
                    }
                }
            }
            let state = self.turn.poll(network, handle);
            if state == TurnState::Busy {
                return ParameterState::Running;
            }
            self.is_transferring = false;
            let result = match state {
                TurnState::Failed(fault) => self.failed(fault),
                TurnState::Done => self.done(network.sdo_data(handle)),
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
    fn start(
        &mut self,
        network: &mut Network,
        handle: NodeHandle,
    ) -> Option<Result<bool, ParameterError>> {
        let Self { set, turn, .. } = self;
        let date = set.date.unwrap_or(ConfigurationDate { days: 0, milliseconds: 0 });
        let started = match self.stage {
            Stage::Unchanged | Stage::Written => return None,
            Stage::ReadDays => turn.upload(network, handle, DAYS),
            Stage::ReadMilliseconds => turn.upload(network, handle, MILLISECONDS),
            Stage::WriteDays => turn.download(network, handle, DAYS, &date.days.to_le_bytes()),
            Stage::WriteMilliseconds => {
                let data = date.milliseconds.to_le_bytes();
                turn.download(network, handle, MILLISECONDS, &data)
            }
            Stage::Save => turn.download(network, handle, SAVE_ALL, &SAVE),
            Stage::Write(nth) => {
                let download = set.parameters.get(nth)?;
                turn.download(network, handle, download.key(), &download.data)
            }
            Stage::ReadBack(nth) => {
                let download = set.parameters.get(nth).filter(|it| it.is_verified)?;
                turn.upload(network, handle, download.key())
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

    /// The transfer of the stage succeeded.
    fn done(&self, value: &[u8]) -> Result<Stage, ParameterError> {
        let is = |expected: Option<u32>| {
            expected.is_some_and(|it| SdoValue::from_bytes(value).raw() == u64::from(it))
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

    /// The transfer of the stage failed. A node without 0x1020 has no configuration date.
    fn failed(&self, fault: SdoFault) -> Result<Stage, ParameterError> {
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
