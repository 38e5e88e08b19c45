//! Everything that the network keeps of one node.

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
    pub(super) fn new(address: NodeAddress, settings: NodeConfig) -> Self {
        Self {
            address,
            nmt: NmtTracker::default(),
            heartbeat: HeartbeatWatch::new(settings.heartbeat_timeout),
            emcy: EmcyLog::default(),
            sdo: SdoClient::new(settings.sdo),
        }
    }

    pub(super) fn status(&self) -> NodeStatus {
        NodeStatus {
            address: self.address,
            nmt_state: self.nmt.reported(),
            expected_nmt_state: self.nmt.expected(),
            boot_ups: self.nmt.boot_ups(),
            heartbeat: self.heartbeat.state(),
            heartbeat_timeouts: self.heartbeat.timeouts(),
            emcy_count: self.emcy.count(),
        }
    }
}

/// What is known of a node, at a glance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeStatus {
    /// Where it is.
    pub address: NodeAddress,
    /// The NMT state that it reported last, by boot-up message or heartbeat; `None` before that,
    /// and after a reset command until it boots.
    pub nmt_state: Option<NmtState>,
    /// The NMT state that the last boot-up message or command leads to: all that is known of a
    /// node without heartbeat. It may have refused.
    pub expected_nmt_state: Option<NmtState>,
    /// Boot-up messages.
    pub boot_ups: u32,
    /// Its heartbeat.
    pub heartbeat: Heartbeat,
    /// How often the heartbeat stayed away.
    pub heartbeat_timeouts: u32,
    /// Emergency messages.
    pub emcy_count: u32,
}
