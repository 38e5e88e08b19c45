//! Configuration of the network and its nodes: plain data.

use std::time::Duration;

use ecan_protocol::image::Schedule;

use super::guarding_config::GuardingConfig;
use super::node_action::Step;
use crate::{NodeId, object};

/// Use of SDO block transfer with a node (CiA 301, 7.2.4.2.9 to 7.2.4.2.16).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockTransferConfig {
    /// Downloads of at least this many bytes try block transfer first; `None` never does.
    pub download_from: Option<usize>,
    /// True if every upload requests a block transfer. A server that supports it still sends small
    /// objects in one frame; one that does not costs one rejected request, once.
    pub upload: bool,
    /// Segments that the server may send in a row in an upload, 1..127. A block arrives as fast as
    /// the bus carries it, so it must fit the receive cache of the gateway's channel (0x8021:07,
    /// at most 32 frames) together with the other traffic of a cycle.
    pub segments: u8,
}

impl Default for BlockTransferConfig {
    /// Downloads from 64 bytes, no uploads, blocks of 16 segments.
    fn default() -> Self {
        Self { download_from: Some(64), upload: false, segments: 16 }
    }
}

impl BlockTransferConfig {
    /// No block transfer.
    pub const NEVER: Self = Self { download_from: None, upload: false, segments: 1 };
}

/// SDO client of one server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SdoConfig {
    /// Longest time for an answer, from the request's acceptance by the gateway.
    pub timeout: Duration,
    /// Longest time for the answer to a download of 0x1010 or 0x1011, if it is above `timeout`: a node may write its
    /// memory before it answers.
    pub storage_timeout: Duration,
    /// Repetitions of a transfer after a missing or damaged answer. A repeated download writes the
    /// same value again. A transfer that the server aborts is never repeated.
    pub retries: u8,
    /// Longest value that can be transferred, in bytes; allocated once.
    pub buffer_bytes: usize,
    /// Block transfer.
    pub block: BlockTransferConfig,
}

impl Default for SdoConfig {
    /// 500 ms, 5 s to store and restore parameters, two retries, 1024 bytes.
    fn default() -> Self {
        Self {
            timeout: Duration::from_millis(500),
            storage_timeout: Duration::from_millis(5_000),
            retries: 2,
            buffer_bytes: 1024,
            block: BlockTransferConfig::default(),
        }
    }
}

/// Configuration of one node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NodeConfig {
    /// Longest time between two heartbeats; zero does not watch them. Choose it well above the
    /// producer time in the node's 0x1017.
    pub heartbeat_timeout: Duration,
    /// Node guarding in place of the heartbeat, for a node without heartbeat producer. `None` does not guard.
    pub guarding: Option<GuardingConfig>,
    /// SDO client.
    pub sdo: SdoConfig,
}

/// Heartbeat of the host, by which drives detect that it has stopped (their consumer time in
/// 0x1016). It is sent on every channel that has a node, and ends with the cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HostHeartbeat {
    /// Node-ID of the host; no node on its channels may have the same.
    pub node: NodeId,
    /// Time between two heartbeats; at least 1 ms.
    pub period: Duration,
}

/// Production of SYNC (CiA 301, 7.2.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SyncConfig {
    /// Cycles from one SYNC to the next; 0 counts as 1.
    pub every_cycles: u32,
    /// Counter as data, from 1 to this value: 2..240, the value of 0x1019 in the nodes. `None`
    /// sends SYNC without data.
    pub counter_overflow: Option<u8>,
    /// Sends at a phase of the next Sync0 period instead of at once (manual 8.4, 13.8).
    pub schedule: Option<Schedule>,
}

impl SyncConfig {
    /// Step that makes a node expect this counter, or none: 0x1019. The node must be pre-operational, and its
    /// communication cycle period 0x1006 must be 0. Tolerates a node without the object.
    pub fn counter_step(&self) -> Step {
        let overflow = self.counter_overflow.unwrap_or(0);
        Step::write(object::SYNC_COUNTER_OVERFLOW, 0, overflow).named("SYNC counter").if_present()
    }
}

impl Default for SyncConfig {
    /// In every cycle, without a counter, at once.
    fn default() -> Self {
        Self { every_cycles: 1, counter_overflow: None, schedule: None }
    }
}

/// Configuration of the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NetworkConfig {
    /// Most SDO frames and NMT commands per cycle and channel; 0 counts as 1. Together with the
    /// process data of a cycle they should not exceed what the gateway serves (0x8021:12, at most
    /// 8).
    pub service_frames_per_cycle: u8,
    /// SDO frames wait while the channel's status word reports at least this many frames that the
    /// gateway has not sent yet (manual 7; the field ends at 7). So they do not delay the next
    /// cycle's process data on a channel that is full.
    pub sdo_pending_limit: u8,
    /// Bytes of each RxPDO image that SDO frames leave free, for frames that are sent after
    /// [`Network::send`](crate::Network::send) in the same cycle.
    pub reserved_image_bytes: usize,
    /// Capacity of the queue of NMT commands of a channel.
    pub nmt_queue: usize,
    /// Heartbeat of the host.
    pub host_heartbeat: Option<HostHeartbeat>,
}

impl Default for NetworkConfig {
    /// Two service frames, no SDO frame while 7 are pending, nothing reserved, no heartbeat.
    fn default() -> Self {
        Self {
            service_frames_per_cycle: 2,
            sdo_pending_limit: 7,
            reserved_image_bytes: 0,
            nmt_queue: 32,
            host_heartbeat: None,
        }
    }
}
