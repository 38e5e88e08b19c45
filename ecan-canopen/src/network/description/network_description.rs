//! Description of a network.

use ecan_protocol::config::McanChannelConfig;

use super::node_description::NodeDescription;
use crate::network::config::{HostHeartbeat, SyncConfig};

/// A channel of a network.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelDescription {
    /// Slave index.
    pub slave: usize,
    /// Channel, 0..3.
    pub channel: u8,
    /// Its bit rates.
    pub can: McanChannelConfig,
}

/// Description of a network: plain data.
#[derive(Debug, Clone, PartialEq)]
pub struct NetworkDescription {
    /// The nodes.
    pub nodes: Vec<NodeDescription>,
    /// The enabled channels.
    pub channels: Vec<ChannelDescription>,
    /// Heartbeat of the host.
    pub host_heartbeat: Option<HostHeartbeat>,
    /// SYNC of the host.
    pub sync: Option<SyncConfig>,
    /// Cycle time in nanoseconds.
    pub cycle_ns: u32,
}
