//! State of one node.

use crate::NmtState;

use super::address::NodeAddress;
use super::boot::ParameterDownload;
use super::config::NodeConfig;
use super::emcy_log::EmcyLog;
use super::guarding::{GuardErrors, NodeGuard};
use super::heartbeat::{Heartbeat, HeartbeatWatch};
use super::nmt_tracker::NmtTracker;
use super::sdo::SdoClient;

#[derive(Debug)]
pub(super) struct Node {
    pub(super) address: NodeAddress,
    pub(super) nmt: NmtTracker,
    pub(super) heartbeat: HeartbeatWatch,
    /// In place of the heartbeat.
    pub(super) guard: Option<NodeGuard>,
    pub(super) emcy: EmcyLog,
    pub(super) sdo: SdoClient,
    /// Parameters for [`NodeAction::WriteParameters`](super::node_action::NodeAction).
    pub(super) parameters: Option<ParameterDownload>,
}

impl Node {
    pub(super) fn new(address: NodeAddress, config: NodeConfig) -> Self {
        Self {
            address,
            nmt: NmtTracker::default(),
            heartbeat: HeartbeatWatch::new(config.heartbeat_timeout),
            guard: config.guarding.map(NodeGuard::new),
            emcy: EmcyLog::default(),
            sdo: SdoClient::new(config.sdo),
            parameters: None,
        }
    }

    /// Life sign, by heartbeat or guarding.
    #[inline]
    pub(super) fn life(&self) -> Heartbeat {
        self.guard.as_ref().map_or(self.heartbeat.state(), NodeGuard::state)
    }

    #[inline]
    pub(super) fn status(&self) -> NodeStatus {
        NodeStatus {
            address: self.address,
            nmt_state: self.nmt.reported(),
            expected_nmt_state: self.nmt.expected(),
            boot_ups: self.nmt.boot_ups(),
            heartbeat: self.life(),
            heartbeat_timeouts: self
                .guard
                .map_or(self.heartbeat.timeouts(), |guard| guard.timeouts),
            guard_errors: self.guard.map_or(GuardErrors::default(), |guard| guard.errors),
            emcy_count: self.emcy.count(),
            error_code: self.emcy.last_code(),
        }
    }
}

/// Status of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeStatus {
    /// Address of the node.
    pub address: NodeAddress,
    /// NMT state that it reported last, by boot-up message, heartbeat or guarding; `None` before the first report, and
    /// after a reset command until its boot-up message.
    pub nmt_state: Option<NmtState>,
    /// NMT state to which the last boot-up message or command leads: the only information about a node
    /// without heartbeat. The node may have rejected the command.
    pub expected_nmt_state: Option<NmtState>,
    /// Number of boot-up messages.
    pub boot_ups: u32,
    /// State of its life sign: of its heartbeat, or of node guarding.
    pub heartbeat: Heartbeat,
    /// Number of timeouts of the life sign.
    pub heartbeat_timeouts: u32,
    /// Number of errors of node guarding; 0 without guarding.
    pub guard_errors: GuardErrors,
    /// Number of emergency messages.
    pub emcy_count: u32,
    /// Error code of the last one; 0 for none, or after the node reset its error.
    pub error_code: u16,
}
