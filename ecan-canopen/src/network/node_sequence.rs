//! Execution of a list of steps on one node.

use std::ops::Deref;
use std::time::Duration;

use ecan_protocol::object::AbortCode;
use ecan_protocol::sequence::{ObjectAccess, SdoValue, Sequence, SequenceState, Transfer};

use super::address::NodeHandle;
use super::error::NmtError;
use super::network::Network;
use super::node_action::{NodeAction, Step};
use super::sdo::Sdo;
use super::sdo_error::{SdoFault, SdoStartError};
use super::step_failure::{NodeAccessError, StepFailure};

/// State of a configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Configuring {
    /// Steps remain.
    Running,
    /// All steps are complete.
    Done,
    /// A step failed; of several nodes, the first one that failed, after all others have ended.
    Failed(StepFailure),
}

/// Executes a list of steps on one node, as much as possible in each cycle.
///
/// The list `S` is any slice of steps: a `Vec`, or a [`List`](ecan_protocol::config::List), which
/// makes the sequence `Copy` and free of allocation. While a transfer runs, the node's SDO client
/// belongs to the sequence; if the application starts a transfer in between, the sequence waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NodeSequence<S> {
    sequence: Sequence<S>,
    client: ClientState,
    failure: Option<StepFailure>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct ClientState {
    /// Number of the sequence's last transfer.
    generation: u64,
    /// Boot-up messages at the last NMT command, or at the start.
    boot_ups: Option<u32>,
}

impl<S> NodeSequence<S> {
    /// Creates a sequence at its first step.
    pub const fn new(steps: S) -> Self {
        let client = ClientState { generation: 0, boot_ups: None };
        Self { sequence: Sequence::new(steps), client, failure: None }
    }

    /// The steps and the position in them.
    pub fn sequence(&self) -> &Sequence<S> {
        &self.sequence
    }

    /// All steps, to append some.
    pub fn steps_mut(&mut self) -> &mut S {
        self.sequence.steps_mut()
    }

    /// Failure that ended the sequence.
    pub fn failure(&self) -> Option<StepFailure> {
        self.failure
    }

    /// Starts over at the first step; [`cancel`](Self::cancel) a running transfer before. Real-time
    /// safe.
    pub fn restart(&mut self) {
        self.sequence.restart();
        self.client = ClientState::default();
        self.failure = None;
    }

    /// Cancels the running transfer. Real-time safe.
    pub fn cancel(&self, network: &mut Network, handle: NodeHandle) {
        if self.sequence.is_transferring() {
            network.cancel_sdo(handle);
        }
    }
}

impl<S: Deref<Target = [Step]>> NodeSequence<S> {
    /// Executes steps until one must wait, all are complete, or one fails; after a failure it does
    /// nothing. `on_read` receives index, subindex and value of each read. Call once per cycle,
    /// between [`Network::receive`] and [`Network::send`]. Real-time safe.
    pub fn advance(
        &mut self,
        network: &mut Network,
        handle: NodeHandle,
        now_ns: u64,
        on_read: impl FnMut(u16, u8, u64),
    ) -> Configuring {
        if let Some(failure) = self.failure {
            return Configuring::Failed(failure);
        }
        let Some(status) = network.status(handle) else { return Configuring::Done };
        self.client.boot_ups.get_or_insert(status.boot_ups);
        let mut access = NodeAccess { network, handle, client: &mut self.client };
        match self.sequence.advance(&mut access, now_ns, on_read) {
            SequenceState::Running => Configuring::Running,
            SequenceState::Done => Configuring::Done,
            SequenceState::Failed(fault) => {
                let failure = StepFailure {
                    address: status.address,
                    nth: self.sequence.position(),
                    of: self.sequence.steps().len(),
                    step: self.sequence.current().unwrap_or_default(),
                    fault,
                };
                self.failure = Some(failure);
                Configuring::Failed(failure)
            }
        }
    }
}

struct NodeAccess<'a> {
    network: &'a mut Network,
    handle: NodeHandle,
    client: &'a mut ClientState,
}

impl NodeAccess<'_> {
    fn started(&mut self, started: Result<(), SdoStartError>) -> Result<bool, NodeAccessError> {
        match started {
            Ok(()) => {
                self.client.generation = self.network.sdo_generation(self.handle);
                Ok(true)
            }
            Err(SdoStartError::Busy) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }
}

impl ObjectAccess for NodeAccess<'_> {
    type Action = NodeAction;
    type Error = NodeAccessError;

    fn start_write(&mut self, index: u16, subindex: u8, data: &[u8]) -> Result<bool, Self::Error> {
        let started = self.network.start_download(self.handle, index, subindex, data);
        self.started(started)
    }

    fn start_read(&mut self, index: u16, subindex: u8) -> Result<bool, Self::Error> {
        let started = self.network.start_upload(self.handle, index, subindex);
        self.started(started)
    }

    fn poll(&mut self) -> Result<Transfer, Self::Error> {
        if self.network.sdo_generation(self.handle) != self.client.generation {
            return Ok(Transfer::Lost);
        }
        match self.network.sdo_state(self.handle) {
            Sdo::Busy => Ok(Transfer::Busy),
            Sdo::Done { .. } => {
                let value = SdoValue::from_bytes(self.network.sdo_data(self.handle));
                Ok(Transfer::Done(value.raw()))
            }
            Sdo::Failed(fault) => Err(fault.into()),
            Sdo::Idle => Err(SdoFault::Cancelled.into()),
        }
    }

    fn act(&mut self, action: &NodeAction, elapsed: Duration) -> Result<bool, Self::Error> {
        let status = self.network.status(self.handle).ok_or(SdoStartError::UnknownNode)?;
        match *action {
            NodeAction::Nmt(command) => match self.network.nmt(self.handle, command) {
                Ok(()) => {
                    self.client.boot_ups = Some(status.boot_ups);
                    Ok(true)
                }
                Err(NmtError::QueueFull { .. }) => Ok(false),
                Err(NmtError::UnknownNode | NmtError::UnknownChannel { .. }) => {
                    Err(SdoStartError::UnknownNode.into())
                }
            },
            NodeAction::AwaitBootUp { timeout } => {
                if self.client.boot_ups != Some(status.boot_ups) {
                    Ok(true)
                } else if elapsed > timeout {
                    Err(NodeAccessError::NoBootUp { waited: elapsed })
                } else {
                    Ok(false)
                }
            }
            NodeAction::AwaitState { state, timeout } => {
                let reported = status.nmt_state;
                if reported == Some(state) {
                    Ok(true)
                } else if elapsed > timeout {
                    Err(NodeAccessError::State { reported, waited: elapsed })
                } else {
                    Ok(false)
                }
            }
        }
    }

    fn abort_code(error: &Self::Error) -> Option<AbortCode> {
        match error {
            NodeAccessError::Sdo(SdoFault::Aborted(code)) => Some(*code),
            _ => None,
        }
    }
}
