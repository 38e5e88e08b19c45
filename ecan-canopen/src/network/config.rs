//! Configuration of the network and its nodes: plain data.

use std::fmt;
use std::time::Duration;

use ecan_protocol::image::Schedule;
use ecan_protocol::sequence;

use crate::{NmtCommand, NmtState, NodeId, object};

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

/// Address of a CANopen node: gateway, channel and node-ID.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct NodeAddress {
    /// Slave index of the gateway in the Port.
    pub slave: usize,
    /// Channel of the gateway, 0..3.
    pub channel: u8,
    /// Node-ID, 1..127.
    pub node: NodeId,
}

impl fmt::Display for NodeAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "node {} (slave {}, channel {})", self.node, self.slave, self.channel)
    }
}

/// A node of one [`Network`](crate::Network), by its index there.
///
/// In another network it refers to another node or to none; a call for no node does nothing, or
/// returns its error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeHandle(pub(crate) usize);

impl NodeHandle {
    /// Index of the node, in the order in which nodes were added, from 0.
    pub fn index(self) -> usize {
        self.0
    }
}

/// Node guarding of a node: the host asks for its NMT state, and the node detects by the requests that the host
/// runs (life guarding). For nodes without heartbeat producer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct GuardingConfig {
    /// Time between two requests, 1 ms to 65535 ms, in whole milliseconds (0x100C).
    pub guard_time: Duration,
    /// The node, and the host, react after this multiple of the guard time without response or request, 1 to 255
    /// (0x100D).
    pub life_time_factor: u8,
}

impl GuardingConfig {
    /// Longest time between two valid responses: guard time times life time factor.
    pub fn life_time(&self) -> Duration {
        self.guard_time * u32::from(self.life_time_factor)
    }

    /// Returns whether guard time and factor are in range.
    pub fn is_valid(&self) -> bool {
        self.checked_ms().is_some()
    }

    /// Guard time in milliseconds; `None` if it or the factor is out of range.
    pub(super) fn checked_ms(&self) -> Option<u16> {
        let is_whole = self.guard_time.subsec_nanos().is_multiple_of(1_000_000);
        let ms = u16::try_from(self.guard_time.as_millis()).ok()?;
        (is_whole && ms > 0 && self.life_time_factor > 0).then_some(ms)
    }
}

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
