//! Actions of a step that concern the NMT state of a node.

use std::fmt;
use std::time::Duration;

use ecan_protocol::sequence;

use super::guarding_config::GuardingConfig;
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
    /// Watches the node's heartbeat with this timeout from now on, and waits for the first one.
    AwaitHeartbeat {
        /// Longest time between two heartbeats, and longest waiting time.
        timeout: Duration,
    },
    /// Guards the node from now on, and waits for its first response, at most its life time. The
    /// node must have 0x100C and 0x100D, see [`GuardingConfig::steps`].
    AwaitGuarding(GuardingConfig),
    /// Writes the parameters of [`Network::set_parameters`](crate::Network::set_parameters), reads
    /// them back and writes their date; nothing without parameters.
    WriteParameters,
}

impl fmt::Display for NodeAction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nmt(command) => write!(f, "NMT {command}"),
            Self::AwaitBootUp { .. } => f.write_str("wait for the boot-up message"),
            Self::WriteParameters => f.write_str("write the parameters"),
            Self::AwaitGuarding(_) => f.write_str("wait for a guarding response"),
            Self::AwaitHeartbeat { .. } => f.write_str("wait for the heartbeat"),
            Self::AwaitState { state, .. } => write!(f, "wait for NMT state {state}"),
        }
    }
}
