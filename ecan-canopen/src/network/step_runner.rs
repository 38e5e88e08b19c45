//! Carries one step out, a bit in every cycle.

use ecan_host::SdoDirection;

use super::address::NodeHandle;
use super::error::{SdoFault, SdoStartError};
use super::heartbeat::NS_PER_MS;
use super::network::Network;
use super::sdo::Sdo;
use super::step::{Action, SdoValue, Step, raw_value};
use super::step_failure::StepFault;

/// What one turn of a step came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turn {
    Busy,
    Done,
    Uploaded(u16, u8, u64),
    Failed(StepFault),
}

/// Where the step under way is.
#[derive(Debug, Clone, Copy, Default)]
enum Stage {
    /// Nothing done yet.
    #[default]
    Fresh,
    /// The transfer of this number runs.
    Transferring(SdoDirection, u64),
    /// A changed value is to be written.
    Changed(u32),
    /// Waiting since the step began.
    Waiting,
}

/// Carries out one step after the other.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct StepRunner {
    stage: Stage,
    /// When the step under way began; `None` before the first turn.
    since_ns: Option<u64>,
    /// Boot-up messages at the last NMT command, or at the beginning.
    boot_ups: Option<u32>,
}

impl StepRunner {
    pub(super) fn is_transferring(&self) -> bool {
        matches!(self.stage, Stage::Transferring(..))
    }

    pub(super) fn elapsed_ns(&self, now_ns: u64) -> u64 {
        self.since_ns.map_or(0, |since| now_ns.saturating_sub(since))
    }

    /// One turn of `step`. After anything but `Busy` the next turn belongs to the next step.
    pub(super) fn turn(
        &mut self,
        step: &Step,
        network: &mut Network,
        handle: NodeHandle,
        now_ns: u64,
    ) -> Turn {
        self.since_ns.get_or_insert(now_ns);
        let boot_ups = network.status(handle).map_or(0, |status| status.boot_ups);
        self.boot_ups.get_or_insert(boot_ups);
        if let Stage::Transferring(_, number) = self.stage
            && number != network.sdo_generation(handle)
        {
            // The application has used the client in between: the result is gone, begin anew.
            self.stage = Stage::Fresh;
        }
        let turn = match self.advance(step, network, handle, now_ns) {
            Ok(turn) => turn,
            Err(StepFault::Sdo(SdoFault::Aborted(code))) if step.tolerance.covers(code) => {
                Turn::Done
            }
            Err(StepFault::Mismatch { .. })
                if step.tolerance == super::Tolerance::TargetRejection =>
            {
                Turn::Done
            }
            Err(fault) => Turn::Failed(fault),
        };
        if turn != Turn::Busy {
            self.stage = Stage::Fresh;
            self.since_ns = Some(now_ns);
        }
        turn
    }

    fn advance(
        &mut self,
        step: &Step,
        network: &mut Network,
        handle: NodeHandle,
        now_ns: u64,
    ) -> Result<Turn, StepFault> {
        match step.action {
            Action::Write { index, subindex, value } => match self.stage {
                Stage::Transferring(..) => {
                    Ok(if finished(network, handle)? { Turn::Done } else { Turn::Busy })
                }
                _ => self.download(network, handle, (index, subindex), value),
            },
            Action::Modify { index, subindex, clear, set } => match self.stage {
                Stage::Transferring(SdoDirection::Upload, _) => {
                    if finished(network, handle)? {
                        let found = raw_value(network.sdo_data(handle)) as u32;
                        let value = found & !clear | set;
                        self.stage = Stage::Changed(value);
                        return self.download(network, handle, (index, subindex), value.into());
                    }
                    Ok(Turn::Busy)
                }
                Stage::Transferring(SdoDirection::Download, _) => {
                    Ok(if finished(network, handle)? { Turn::Done } else { Turn::Busy })
                }
                Stage::Changed(value) => {
                    self.download(network, handle, (index, subindex), value.into())
                }
                _ => self.upload(network, handle, (index, subindex)),
            },
            Action::Read { index, subindex } => match self.stage {
                Stage::Transferring(..) => Ok(if finished(network, handle)? {
                    Turn::Uploaded(index, subindex, raw_value(network.sdo_data(handle)))
                } else {
                    Turn::Busy
                }),
                _ => self.upload(network, handle, (index, subindex)),
            },
            Action::Expect { index, subindex, value, mask } => match self.stage {
                Stage::Transferring(..) => {
                    if !finished(network, handle)? {
                        return Ok(Turn::Busy);
                    }
                    let found = raw_value(network.sdo_data(handle));
                    if (found ^ value) & mask == 0 {
                        Ok(Turn::Done)
                    } else {
                        Err(StepFault::Mismatch { found, expected: value, mask })
                    }
                }
                _ => self.upload(network, handle, (index, subindex)),
            },
            Action::Nmt(command) => {
                let boot_ups = network.status(handle).map(|status| status.boot_ups);
                match network.nmt(handle, command) {
                    Ok(()) => {
                        self.boot_ups = boot_ups;
                        Ok(Turn::Done)
                    }
                    Err(super::NmtError::QueueFull { .. }) => Ok(Turn::Busy),
                    Err(super::NmtError::UnknownNode) => Err(SdoStartError::UnknownNode.into()),
                }
            }
            Action::AwaitBootUp { timeout_ms } => {
                self.stage = Stage::Waiting;
                let status = network.status(handle).ok_or(SdoStartError::UnknownNode)?;
                if self.boot_ups != Some(status.boot_ups) {
                    return Ok(Turn::Done);
                }
                self.within(timeout_ms, now_ns, |waited_ms| StepFault::NoBootUp { waited_ms })
            }
            Action::AwaitState { state, timeout_ms } => {
                self.stage = Stage::Waiting;
                let reported = network.nmt_state(handle);
                if reported == Some(state) {
                    return Ok(Turn::Done);
                }
                self.within(timeout_ms, now_ns, |waited_ms| StepFault::State {
                    reported,
                    waited_ms,
                })
            }
            Action::Pause { ms } => {
                self.stage = Stage::Waiting;
                let is_over = self.elapsed_ns(now_ns) >= u64::from(ms) * NS_PER_MS;
                Ok(if is_over { Turn::Done } else { Turn::Busy })
            }
        }
    }

    fn within(
        &self,
        timeout_ms: u32,
        now_ns: u64,
        fault: impl FnOnce(u64) -> StepFault,
    ) -> Result<Turn, StepFault> {
        let waited_ms = self.elapsed_ns(now_ns) / NS_PER_MS;
        if waited_ms > u64::from(timeout_ms) { Err(fault(waited_ms)) } else { Ok(Turn::Busy) }
    }

    fn upload(
        &mut self,
        network: &mut Network,
        handle: NodeHandle,
        (index, subindex): (u16, u8),
    ) -> Result<Turn, StepFault> {
        let started = network.start_upload(handle, index, subindex);
        self.began(network, handle, started, SdoDirection::Upload)
    }

    fn download(
        &mut self,
        network: &mut Network,
        handle: NodeHandle,
        (index, subindex): (u16, u8),
        value: SdoValue,
    ) -> Result<Turn, StepFault> {
        let started = network.start_download(handle, index, subindex, value.as_bytes());
        self.began(network, handle, started, SdoDirection::Download)
    }

    /// While the application uses the node's SDO client itself, the step waits.
    fn began(
        &mut self,
        network: &Network,
        handle: NodeHandle,
        started: Result<(), SdoStartError>,
        direction: SdoDirection,
    ) -> Result<Turn, StepFault> {
        match started {
            Ok(()) => {
                let number = network.sdo_generation(handle);
                self.stage = Stage::Transferring(direction, number);
            }
            Err(SdoStartError::Busy) => {}
            Err(error) => return Err(error.into()),
        }
        Ok(Turn::Busy)
    }
}

/// Whether the running transfer is over.
fn finished(network: &Network, handle: NodeHandle) -> Result<bool, StepFault> {
    match network.sdo_state(handle) {
        Sdo::Busy => Ok(false),
        Sdo::Done { .. } => Ok(true),
        Sdo::Failed(fault) => Err(fault.into()),
        Sdo::Idle => Err(SdoFault::Cancelled.into()),
    }
}
