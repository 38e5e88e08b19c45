//! Configuration that all axes share.

use std::time::Duration;

use ecan_canopen::{HostHeartbeat, NetworkConfig, NodeConfig, SyncConfig};

use crate::axis::takeover::Takeover;

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
    /// Fewest cycles from target to target; 0 counts as 1. See [`target_cycles`](Self::target_cycles).
    pub motion_div: u32,
    /// Treatment of a drive that is enabled at the first contact.
    pub takeover: Takeover,
}

impl Cia402Config {
    /// Cycles from target to target, the target period: the least multiple of
    /// [`SyncConfig::every_cycles`] that is at least [`motion_div`](Self::motion_div), since a target
    /// takes effect with a SYNC. Drives get it as interpolation time 0x60C2.
    pub fn target_cycles(&self) -> u32 {
        target_cycles(self.motion_div, self.sync.every_cycles)
    }
}

pub(super) fn target_cycles(motion_div: u32, cycles_per_sync: u32) -> u32 {
    let cycles_per_sync = cycles_per_sync.max(1);
    motion_div.max(1).checked_next_multiple_of(cycles_per_sync).unwrap_or(cycles_per_sync)
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
            takeover: Takeover::default(),
        }
    }
}
