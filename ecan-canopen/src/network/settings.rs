//! What the network and its nodes are told: plain data.

use crate::NodeId;
use ecan_protocol::image::Schedule;

/// How SDO block transfer is used with a node (CiA 301, 7.2.4.2.9 to 7.2.4.2.16).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockTransferConfig {
    /// Downloads of at least so many bytes try block transfer first; `None` never does.
    pub download_from: Option<usize>,
    /// Whether every upload asks for a block transfer. A server that supports it answers small
    /// objects in one frame all the same; one that does not costs one refused request, once.
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
    /// No block transfer at all.
    pub const NEVER: Self = Self { download_from: None, upload: false, segments: 1 };
}

/// How the SDO client talks to one server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SdoConfig {
    /// How long an answer may take after the request was handed to the gateway, in milliseconds.
    pub timeout_ms: u32,
    /// How often a transfer starts over after a missing or damaged answer. A download that starts
    /// over writes the same value again. What the server refuses is never tried again.
    pub retries: u8,
    /// Longest value that can be transferred, in bytes; allocated once.
    pub buffer_bytes: usize,
    /// Block transfer.
    pub block: BlockTransferConfig,
}

impl Default for SdoConfig {
    /// 500 ms, two retries, 1024 bytes.
    fn default() -> Self {
        Self {
            timeout_ms: 500,
            retries: 2,
            buffer_bytes: 1024,
            block: BlockTransferConfig::default(),
        }
    }
}

/// What the network knows of one node beforehand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NodeConfig {
    /// How long the node may be silent between two heartbeats, in milliseconds; 0 does not watch
    /// it. To be chosen well above the producer time in the node's 0x1017.
    pub heartbeat_timeout_ms: u32,
    /// Its SDO server.
    pub sdo: SdoConfig,
}

/// The heartbeat that the host itself produces, so that drives notice its death (their consumer
/// time in 0x1016). It goes out on every channel that has a node, and stops when nobody runs the
/// cycle any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HostHeartbeat {
    /// Node-ID of the host; no node on its channels may have the same.
    pub node: NodeId,
    /// Time between two heartbeats, in milliseconds.
    pub period_ms: u32,
}

/// How SYNC is produced (CiA 301, 7.2.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SyncConfig {
    /// Cycles from one SYNC to the next; 0 counts as 1.
    pub every_cycles: u32,
    /// With a counter as data, that runs from 1 to this value and starts over: 2..240, the value
    /// of 0x1019 in the nodes. `None` sends SYNC without data.
    pub counter_overflow: Option<u8>,
    /// Sends at a phase of the next Sync0 period instead of at once (manual 8.4, 13.8).
    pub schedule: Option<Schedule>,
}

impl Default for SyncConfig {
    /// In every cycle, without a counter, at once.
    fn default() -> Self {
        Self { every_cycles: 1, counter_overflow: None, schedule: None }
    }
}

/// What the network is told as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NetworkConfig {
    /// SDO frames and NMT commands per cycle and channel at most; 0 counts as 1. Together with
    /// the process data of a cycle they should not exceed what the gateway serves (0x8021:12, at
    /// most 8).
    pub service_frames_per_cycle: u8,
    /// SDO frames wait while the channel's status word reports at least so many frames that the
    /// gateway has not sent yet (manual 7; the field ends at 7). So they never queue up before
    /// the next cycle's process data on a channel that is full.
    pub sdo_pending_limit: u8,
    /// Bytes of each RxPDO image that SDO frames leave free, for frames that are sent after
    /// [`Network::send`](crate::Network::send) in the same cycle.
    pub reserved_image_bytes: usize,
    /// NMT commands that can wait for a channel.
    pub nmt_queue: usize,
    /// The host's own heartbeat.
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
