//! Configuration that all axes share.

use std::time::Duration;

use ecan_canopen::{HostHeartbeat, NetworkConfig, NodeConfig, SyncConfig};

/// Configuration that all axes of a bus share.
#[derive(Debug, Clone, PartialEq)]
pub struct Cia402Config {
    /// CANopen network; by its host heartbeat drives detect that the host has stopped.
    pub network: NetworkConfig,
    /// SDO client of each node. Its heartbeat timeout follows from
    /// [`DriveConfig::heartbeat_ms`](crate::DriveConfig::heartbeat_ms).
    pub node: NodeConfig,
    /// Production of SYNC, with which the drives apply targets and send TPDOs.
    pub sync: SyncConfig,
    /// Cycles from target to target; 0 counts as 1.
    pub motion_div: u32,
}

impl Default for Cia402Config {
    /// SYNC and targets in every cycle, at once; a heartbeat of the host every 50 ms, as node 127.
    fn default() -> Self {
        let node = ecan_canopen::NodeId::MAX;
        Self {
            network: NetworkConfig {
                host_heartbeat: Some(HostHeartbeat { node, period: Duration::from_millis(50) }),
                ..NetworkConfig::default()
            },
            node: NodeConfig::default(),
            sync: SyncConfig::default(),
            motion_div: 1,
        }
    }
}
