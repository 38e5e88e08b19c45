//! State of one node.

use crate::NmtState;

use super::address::NodeAddress;
use super::config::NodeConfig;
use super::emcy_log::EmcyLog;
use super::heartbeat::{Heartbeat, HeartbeatWatch};
use super::nmt_tracker::NmtTracker;
use super::sdo::SdoClient;

#[derive(Debug)]
pub(super) struct Node {
    pub(super) address: NodeAddress,
    pub(super) nmt: NmtTracker,
    pub(super) heartbeat: HeartbeatWatch,
    pub(super) emcy: EmcyLog,
    pub(super) sdo: SdoClient,
}

impl Node {
    pub(super) fn new(address: NodeAddress, config: NodeConfig) -> Self {
        Self {
            address,
            nmt: NmtTracker::default(),
            heartbeat: HeartbeatWatch::new(config.heartbeat_timeout),
            emcy: EmcyLog::default(),
            sdo: SdoClient::new(config.sdo),
        }
    }

    #[inline]
    pub(super) fn status(&self) -> NodeStatus {
        NodeStatus {
            address: self.address,
            nmt_state: self.nmt.reported(),
            expected_nmt_state: self.nmt.expected(),
            boot_ups: self.nmt.boot_ups(),
            heartbeat: self.heartbeat.state(),
            heartbeat_timeouts: self.heartbeat.timeouts(),
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
    /// NMT state that it reported last, by boot-up message or heartbeat; `None` before the first report, and
    /// after a reset command until its boot-up message.
    pub nmt_state: Option<NmtState>,
    /// NMT state to which the last boot-up message or command leads: the only information about a node
    /// without heartbeat. The node may have rejected the command.
    pub expected_nmt_state: Option<NmtState>,
    /// Number of boot-up messages.
    pub boot_ups: u32,
    /// State of its heartbeat.
    pub heartbeat: Heartbeat,
    /// Number of heartbeat timeouts.
    pub heartbeat_timeouts: u32,
    /// Number of emergency messages.
    pub emcy_count: u32,
    /// Error code of the last one; 0 for none, or after the node reset its error.
    pub error_code: u16,
}
