//! The CANopen master of the nodes that are connected to the gateways of a Port.

use std::time::Duration;

use crate::{NmtCommand, NmtRequest, NmtState, NodeId};
use ecan_protocol::mapping::CHANNELS;

use super::address::{NodeAddress, NodeHandle};
use super::boot::NetworkBoot;
use super::channel::Channel;
use super::config::{HostHeartbeat, NetworkConfig, NodeConfig, SyncConfig};
use super::emcy_log::EmcyLog;
use super::error::{NetworkError, NmtError};
use super::guarding::NodeGuard;
use super::guarding_config::GuardingConfig;
use super::heartbeat::Heartbeat;
use super::node::{Node, NodeStatus};
use super::sdo::{Sdo, SdoClient};
use super::sdo_error::{SdoFailure, SdoStartError};
use super::statistics::ServiceStatistics;
use super::time_producer::TimeConfig;

/// CANopen master of all nodes that are connected to the gateways of a Port (CiA 301): NMT,
/// heartbeat, EMCY, SYNC and one SDO client per node.
///
/// No call blocks. In every cycle:
///
/// ```text
/// network.receive(cycle, now, |other| ..)  takes its frames, passes on others: TPDOs, reports
/// ..                                       targets: RPDOs, sent by the application
/// network.send_sync(cycle)                 SYNC after them
/// network.send(cycle, now)                 NMT, heartbeat and SDO frames that are due
/// ```
///
/// In this order the frames of a cycle are in the transmit FIFO of their channel: targets, then
/// the SYNC that makes them effective, then at most
/// [`NetworkConfig::service_frames_per_cycle`] service frames. A frame waits for a later cycle if
/// it finds no space, or if its gateway is not ready.
///
/// When a gateway is lost, SDO transfers with its nodes end with
/// [`SdoFault::GatewayLost`](crate::SdoFault::GatewayLost), NMT commands in its queues are
/// dropped, and heartbeats time out. Later transfers and commands wait until the gateway is ready.
///
/// Adding nodes and blocking calls allocate; the cycle does not. `now_ns` is the time of the bus
/// clock, [`Adapter::clock`](ecan_host::Adapter::clock).
#[derive(Debug)]
pub struct Network {
    pub(super) config: NetworkConfig,
    pub(super) nodes: Vec<Node>,
    pub(super) channels: Vec<Channel>,
    pub(super) sync: Option<SyncConfig>,
    pub(super) time: Option<TimeConfig>,
    pub(super) statistics: ServiceStatistics,
    pub(super) boot: NetworkBoot,
    /// Number of the cycle of the Adapter in which frames were received last; the first one is 1.
    pub(super) last_cycle: u64,
}

impl Network {
    /// Creates a network without nodes.
    pub fn new(config: NetworkConfig) -> Self {
        Self {
            config,
            nodes: Vec::new(),
            channels: Vec::new(),
            sync: None,
            time: None,
            statistics: ServiceStatistics::default(),
            boot: NetworkBoot::default(),
            last_cycle: 0,
        }
    }

    /// Adds a node. Allocates; call it before the cycle.
    ///
    /// # Errors
    /// A [`NetworkError`]; nothing was added.
    pub fn add_node(
        &mut self,
        address: NodeAddress,
        config: NodeConfig,
    ) -> Result<NodeHandle, NetworkError> {
        if usize::from(address.channel) >= CHANNELS {
            return Err(NetworkError::Channel { address });
        }
        if self.config.host_heartbeat.is_some_and(|host| host.node == address.node) {
            return Err(NetworkError::HostNode { address });
        }
        if self.find(address).is_some() {
            return Err(NetworkError::Duplicate { address });
        }
        if let Some(guarding) = config.guarding {
            if guarding.checked_ms().is_none() {
                return Err(NetworkError::Guarding { address, guarding });
            }
            if !config.heartbeat_timeout.is_zero() {
                return Err(NetworkError::HeartbeatAndGuarding { address });
            }
        }
        let nth = self.nodes.len();
        let short = u16::try_from(nth).map_err(|_| NetworkError::TooMany)?;
        self.nodes.push(Node::new(address, config));
        let at = self.ensure_channel(address.slave, address.channel);
        let has_sync = self.sync.is_some();
        if let Some(channel) = self.channels.get_mut(at) {
            if channel.nodes.is_empty() {
                channel.sync.enable(has_sync);
            }
            channel.add_node(address.node, short);
        }
        Ok(NodeHandle(nth))
    }

    /// Index of a channel; adds it if the network does not have it.
    pub(super) fn ensure_channel(&mut self, slave: usize, channel: u8) -> usize {
        self.channel_index(slave, channel).unwrap_or_else(|| {
            self.channels.push(Channel::new(slave, channel, self.config.nmt_queue));
            self.channels.len() - 1
        })
    }

    pub(super) fn channel_mut(&mut self, slave: usize, channel: u8) -> Option<&mut Channel> {
        let nth = self.channel_index(slave, channel)?;
        self.channels.get_mut(nth)
    }

    /// All nodes, in the order in which they were added.
    pub fn handles(&self) -> impl ExactSizeIterator<Item = NodeHandle> + use<> {
        (0..self.nodes.len()).map(NodeHandle)
    }

    /// Address of a node.
    pub fn address(&self, handle: NodeHandle) -> Option<NodeAddress> {
        self.node(handle).map(|node| node.address)
    }

    /// The node at an address; real-time safe.
    pub fn find(&self, address: NodeAddress) -> Option<NodeHandle> {
        self.find_node(address.slave, address.channel, address.node)
    }

    pub(super) fn find_node(&self, slave: usize, channel: u8, node: NodeId) -> Option<NodeHandle> {
        let channel = self.channels.get(self.channel_index(slave, channel)?)?;
        channel.node(node).map(NodeHandle)
    }

    #[inline]
    pub(super) fn node(&self, handle: NodeHandle) -> Option<&Node> {
        self.nodes.get(handle.0)
    }

    pub(super) fn node_mut(&mut self, handle: NodeHandle) -> Option<&mut Node> {
        self.nodes.get_mut(handle.0)
    }

    pub(super) fn channel_index(&self, slave: usize, channel: u8) -> Option<usize> {
        self.channels.iter().position(|c| (c.slave, c.channel) == (slave, channel))
    }

    /// Counters; real-time safe.
    pub fn statistics(&self) -> ServiceStatistics {
        let sdo_strays = self.nodes.iter().map(|node| node.sdo.strays()).sum();
        let lss_strays = self.channels.iter().map(|channel| channel.lss.strays()).sum();
        ServiceStatistics { sdo_strays, lss_strays, ..self.statistics }
    }

    // Node state

    /// Status of a node; real-time safe.
    #[inline]
    pub fn status(&self, handle: NodeHandle) -> Option<NodeStatus> {
        self.node(handle).map(Node::status)
    }

    /// NMT state that a node reported last; `None` before the first report, and after a reset
    /// command until its boot-up message. Real-time safe.
    pub fn nmt_state(&self, handle: NodeHandle) -> Option<NmtState> {
        self.node(handle)?.nmt.reported()
    }

    /// State of a node's life sign, by heartbeat or guarding; real-time safe.
    pub fn heartbeat(&self, handle: NodeHandle) -> Heartbeat {
        self.node(handle).map_or(Heartbeat::Unconfigured, Node::life)
    }

    /// Watches a node's heartbeat with another timeout from now on, and ends guarding; zero stops watching
    /// heartbeats and does not change guarding. Real-time safe.
    pub fn set_heartbeat_timeout(&mut self, handle: NodeHandle, timeout: Duration) {
        if let Some(node) = self.node_mut(handle) {
            node.heartbeat.set_timeout(timeout);
            if !timeout.is_zero() {
                node.guard = None;
            }
        }
    }

    /// Guards a node from now on, and ends the watch of its heartbeat; `None` stops guarding. Write 0x100C and 0x100D
    /// of the node first, see [`GuardingConfig::steps`]. Real-time safe.
    ///
    /// # Errors
    /// [`NetworkError::Guarding`]; nothing is changed.
    pub fn set_guarding(
        &mut self,
        handle: NodeHandle,
        guarding: Option<GuardingConfig>,
    ) -> Result<(), NetworkError> {
        let Some(node) = self.node_mut(handle) else { return Ok(()) };
        if let Some(guarding) = guarding {
            if guarding.checked_ms().is_none() {
                return Err(NetworkError::Guarding { address: node.address, guarding });
            }
            node.heartbeat.set_timeout(Duration::ZERO);
        }
        node.guard = guarding.map(NodeGuard::new);
        Ok(())
    }

    /// Emergency messages of a node; real-time safe.
    pub fn emcy(&self, handle: NodeHandle) -> Option<&EmcyLog> {
        self.node(handle).map(|node| &node.emcy)
    }

    // NMT

    /// Queues an NMT command for one node; [`send`](Self::send) sends it before any SDO frame of
    /// its channel. It waits while the channel accepts no frames, for example in bus-off, and is
    /// dropped when the gateway is lost. Real-time safe.
    ///
    /// # Errors
    /// An [`NmtError`].
    pub fn nmt(&mut self, handle: NodeHandle, command: NmtCommand) -> Result<(), NmtError> {
        let address = self.address(handle).ok_or(NmtError::UnknownNode)?;
        let (slave, channel) = (address.slave, address.channel);
        let nth = self.channel_index(slave, channel).ok_or(NmtError::UnknownNode)?;
        let request = NmtRequest { command, node: Some(address.node) };
        let queued = self.channels.get_mut(nth).is_some_and(|nth| nth.queue_nmt(request));
        if queued { Ok(()) } else { Err(NmtError::QueueFull { slave, channel }) }
    }

    /// Queues an NMT command to all nodes, as one broadcast per channel of the network. It also
    /// reaches nodes that were not added. Real-time safe.
    ///
    /// # Errors
    /// [`NmtError::QueueFull`]; then it is sent to no channel.
    pub fn nmt_all(&mut self, command: NmtCommand) -> Result<(), NmtError> {
        if let Some(full) = self.channels.iter().find(|channel| channel.nmt_is_full()) {
            return Err(NmtError::QueueFull { slave: full.slave, channel: full.channel });
        }
        for channel in &mut self.channels {
            channel.queue_nmt(NmtRequest { command, node: None });
        }
        Ok(())
    }

    /// Queues an NMT command to all nodes of one channel, also to those that were not added. Real-time safe.
    ///
    /// # Errors
    /// [`NmtError::QueueFull`] or [`NmtError::UnknownChannel`].
    pub fn nmt_channel(
        &mut self,
        slave: usize,
        channel: u8,
        command: NmtCommand,
    ) -> Result<(), NmtError> {
        let entry = self.channel_mut(slave, channel);
        let entry = entry.ok_or(NmtError::UnknownChannel { slave, channel })?;
        let queued = entry.queue_nmt(NmtRequest { command, node: None });
        if queued { Ok(()) } else { Err(NmtError::QueueFull { slave, channel }) }
    }

    /// Returns whether NMT commands wait to be sent; real-time safe.
    pub fn nmt_is_pending(&self) -> bool {
        self.channels.iter().any(|channel| channel.next_nmt().is_some())
    }

    /// Withholds SYNC, the host's heartbeat and guarding requests on a channel, or sends them again: nodes that watch
    /// the host are not kept alive while their state is unknown. Ignores a channel without nodes.
    /// Real-time safe.
    pub fn set_paused(&mut self, slave: usize, channel: u8, is_paused: bool) {
        let nth = self.channel_index(slave, channel);
        if let Some(channel) = nth.and_then(|nth| self.channels.get_mut(nth)) {
            channel.is_paused = is_paused;
        }
    }

    /// Heartbeat of the host.
    pub fn host_heartbeat(&self) -> Option<HostHeartbeat> {
        self.config.host_heartbeat
    }

    /// Starts, changes or stops the production of TIME (CiA 301, 7.2.6). The first message is due in the next cycle.
    /// Real-time safe.
    ///
    /// # Errors
    /// [`NetworkError::TimeReference`]; nothing is changed.
    pub fn set_time(&mut self, config: Option<TimeConfig>) -> Result<(), NetworkError> {
        if let Some(config) = &config {
            config.check()?;
        }
        self.time = config;
        for channel in &mut self.channels {
            channel.time.reset();
        }
        Ok(())
    }

    /// Configuration of TIME; `None` if it is off.
    pub fn time(&self) -> Option<TimeConfig> {
        self.time
    }

    // SDO

    /// Starts to upload an object of a node. Real-time safe; the value arrives in later cycles, see
    /// [`sdo_state`](Self::sdo_state) and [`sdo_data`](Self::sdo_data).
    ///
    /// # Errors
    /// [`SdoStartError::Busy`] or [`SdoStartError::UnknownNode`].
    pub fn start_upload(
        &mut self,
        handle: NodeHandle,
        index: u16,
        subindex: u8,
    ) -> Result<(), SdoStartError> {
        self.sdo_mut(handle)?.start_upload(index, subindex)
    }

    /// Starts to upload an object by block transfer, or by segments if the server rejects that.
    /// Real-time safe.
    ///
    /// # Errors
    /// [`SdoStartError::Busy`] or [`SdoStartError::UnknownNode`].
    pub fn start_block_upload(
        &mut self,
        handle: NodeHandle,
        index: u16,
        subindex: u8,
    ) -> Result<(), SdoStartError> {
        self.sdo_mut(handle)?.start_block_upload(index, subindex)
    }

    /// Starts to download an object of a node: expedited up to four bytes, in segments or blocks
    /// above. The bytes are copied. Real-time safe.
    ///
    /// # Errors
    /// An [`SdoStartError`].
    pub fn start_download(
        &mut self,
        handle: NodeHandle,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), SdoStartError> {
        self.sdo_mut(handle)?.start_download(index, subindex, data)
    }

    /// Cancels the transfer with a node and sends the node an abort. Real-time safe.
    pub fn cancel_sdo(&mut self, handle: NodeHandle) {
        if let Some(node) = self.node_mut(handle) {
            node.sdo.cancel();
        }
    }

    /// Number of SDO requests to a node that timed out, including those that a repetition then
    /// completed. Real-time safe.
    pub fn sdo_silences(&self, handle: NodeHandle) -> u64 {
        self.node(handle).map_or(0, |node| node.sdo.silences())
    }

    /// State of the transfer with a node; real-time safe.
    pub fn sdo_state(&self, handle: NodeHandle) -> Sdo {
        self.node(handle).map_or(Sdo::Idle, |node| node.sdo.state())
    }

    /// Value of the last successful transfer with a node, until the next one starts; real-time
    /// safe.
    pub fn sdo_data(&self, handle: NodeHandle) -> &[u8] {
        self.node(handle).map_or(&[], |node| node.sdo.data())
    }

    /// Failure of the last transfer with a node; real-time safe.
    pub fn sdo_failure(&self, handle: NodeHandle) -> Option<SdoFailure> {
        let node = self.node(handle)?;
        let Sdo::Failed(fault) = node.sdo.state() else { return None };
        let (direction, index, subindex) = node.sdo.subject();
        Some(SdoFailure { address: node.address, direction, index, subindex, fault })
    }

    /// Number of transfers that were started with a node: a change shows that another part of the
    /// application has used its SDO client. Real-time safe.
    pub fn sdo_generation(&self, handle: NodeHandle) -> u64 {
        self.node(handle).map_or(0, |node| node.sdo.generation())
    }

    fn sdo_mut(&mut self, handle: NodeHandle) -> Result<&mut SdoClient, SdoStartError> {
        self.node_mut(handle).map(|node| &mut node.sdo).ok_or(SdoStartError::UnknownNode)
    }
}
