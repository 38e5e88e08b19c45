//! Execution of a list of steps on one node.

use std::ops::Deref;
use std::time::Duration;

use ecan_protocol::object::AbortCode;
use ecan_protocol::sequence::{Action, ObjectAccess, SdoValue, Sequence, SequenceState, Transfer};

use super::config::{NodeAction, Step};
use super::error::{NodeAccessError, SdoFault, StepFailure};
use super::life_sign::Heartbeat;
use super::node_table::Member;
use super::sdo::{SdoClient, SdoTurn, TurnState};

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
    turn: SdoTurn,
    /// Boot-up messages at the last NMT command, or at the start.
    boot_ups: Option<u32>,
}

impl<S> NodeSequence<S> {
    /// Creates a sequence at its first step.
    pub fn new(steps: S) -> Self {
        let client = ClientState::default();
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
}

impl<S: Deref<Target = [Step]>> NodeSequence<S> {
    /// Cancels the running transfer.
    pub(super) fn cancel_transfer(&self, client: &mut SdoClient) {
        let is_writing = matches!(
            self.sequence.current().map(|step| step.action),
            Some(Action::Device(NodeAction::WriteParameters))
        );
        let is_transferring =
            self.sequence.is_transferring() && self.client.turn.is_current(client);
        if is_transferring || is_writing {
            client.cancel();
        }
    }

    /// Executes steps until one must wait, all are complete, or one fails; after a failure it does nothing.
    pub(super) fn advance_member(
        &mut self,
        member: &mut Member<'_>,
        now_ns: u64,
        on_read: impl FnMut(u16, u8, u64),
    ) -> Configuring {
        if let Some(failure) = self.failure {
            return Configuring::Failed(failure);
        }
        self.client.boot_ups.get_or_insert(member.node.nmt.boot_ups());
        let address = member.node.address;
        let mut access = NodeAccess { member, client: &mut self.client };
        match self.sequence.advance(&mut access, now_ns, on_read) {
            SequenceState::Running => Configuring::Running,
            SequenceState::Done => Configuring::Done,
            SequenceState::Failed(fault) => {
                let failure = StepFailure {
                    address,
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

struct NodeAccess<'a, 'm> {
    member: &'a mut Member<'m>,
    client: &'a mut ClientState,
}

impl NodeAccess<'_, '_> {
    fn await_life(&self, timeout: Duration, elapsed: Duration) -> Result<bool, NodeAccessError> {
        if self.member.node.life() == Heartbeat::Active {
            Ok(true)
        } else if elapsed > timeout {
            Err(NodeAccessError::NoHeartbeat { waited: elapsed })
        } else {
            Ok(false)
        }
    }
}

impl ObjectAccess for NodeAccess<'_, '_> {
    type Action = NodeAction;
    type Error = NodeAccessError;

    fn start_write(&mut self, index: u16, subindex: u8, data: &[u8]) -> Result<bool, Self::Error> {
        let key = (index, subindex);
        Ok(self.client.turn.download(&mut self.member.node.sdo, key, data)?)
    }

    fn start_read(&mut self, index: u16, subindex: u8) -> Result<bool, Self::Error> {
        Ok(self.client.turn.upload(&mut self.member.node.sdo, (index, subindex))?)
    }

    fn poll(&mut self) -> Result<Transfer, Self::Error> {
        match self.client.turn.poll(&self.member.node.sdo) {
            TurnState::Busy => Ok(Transfer::Busy),
            TurnState::Lost => Ok(Transfer::Lost),
            TurnState::Done => {
                Ok(Transfer::Done(SdoValue::from_bytes(self.member.node.sdo.data()).raw()))
            }
            TurnState::Failed(fault) => Err(fault.into()),
        }
    }

    fn act(&mut self, action: &NodeAction, elapsed: Duration) -> Result<bool, Self::Error> {
        let node = &mut *self.member.node;
        let boot_ups = node.nmt.boot_ups();
        match *action {
            NodeAction::Nmt(command) => {
                let is_queued = self.member.queue_nmt(command);
                if is_queued {
                    self.client.boot_ups = Some(boot_ups);
                }
                Ok(is_queued)
            }
            NodeAction::AwaitBootUp { timeout } => {
                if self.client.boot_ups != Some(boot_ups) {
                    Ok(true)
                } else if elapsed > timeout {
                    Err(NodeAccessError::NoBootUp { waited: elapsed })
                } else {
                    Ok(false)
                }
            }
            NodeAction::WriteParameters => node.write_parameters(elapsed.is_zero()),
            NodeAction::AwaitHeartbeat { timeout } => {
                if elapsed.is_zero() {
                    node.set_heartbeat_timeout(timeout);
                }
                self.await_life(timeout, elapsed)
            }
            NodeAction::AwaitGuarding(guarding) => {
                if elapsed.is_zero() {
                    // A guard time out of range was rejected before: then nothing is guarded.
                    node.set_guarding(Some(guarding));
                }
                self.await_life(guarding.life_time(), elapsed)
            }
            NodeAction::AwaitState { state, timeout } => {
                let reported = node.nmt.reported();
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
