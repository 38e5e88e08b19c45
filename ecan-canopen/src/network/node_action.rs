//! Actions of a step that concern the NMT state of a node.

use std::fmt;
use std::time::Duration;

use ecan_protocol::sequence;

use crate::{NmtCommand, NmtState};

/// One step of the configuration of a node: object access, or a [`NodeAction`].
pub type Step = sequence::Step<NodeAction>;

/// Action of a [`Step`] that concerns the NMT state of a node:
/// `Step::device(NodeAction::Nmt(NmtCommand::Start))`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NodeAction {
    /// Sends an NMT command to the node.
    Nmt(NmtCommand),
    /// Waits for a boot-up message after the last NMT command of the list, or, without one, after
    /// the start of the list.
    AwaitBootUp {
        /// Longest waiting time.
        timeout: Duration,
    },
    /// Waits until the node reports a state, by heartbeat or guarding.
    AwaitState {
        /// The state.
        state: NmtState,
        /// Longest waiting time.
        timeout: Duration,
    },
}

impl fmt::Display for NodeAction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nmt(command) => write!(f, "NMT {command}"),
            Self::AwaitBootUp { .. } => f.write_str("wait for the boot-up message"),
            Self::AwaitState { state, .. } => write!(f, "wait for NMT state {state}"),
        }
    }
}
