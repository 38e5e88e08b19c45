//! The CANopen master of the nodes that are connected to the gateways of a Port.

use std::sync::Arc;
use std::time::Duration;

use ecan_mcan_port::{Cycle, Received, ReceivedFrame};
use ecan_protocol::mapping::CHANNELS;

use super::boot::{BootConfig, BootProgress, BootState, NetworkBoot, ParameterSet};
use super::config::{
    GuardingConfig, HostHeartbeat, NetworkConfig, NodeAddress, NodeConfig, NodeHandle, SyncConfig,
};
use super::error::{NetworkError, NmtError, SdoFailure, SdoStartError};
use super::life_sign::Heartbeat;
use super::lss::{Lss, LssCommand, LssConfig, LssFailure, LssFault, LssStartError};
use super::node::{EmcyLog, Node, NodeStatus};
use super::node_table::{Member, NodeTable};
use super::producers::TimeConfig;
use super::sdo::Sdo;
use super::service_sender::{FrameSink, ServiceSender, ServiceStatistics};
use crate::{NmtCommand, NmtRequest, NmtState};

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
    config: NetworkConfig,
    nodes: NodeTable,
    sync: Option<SyncConfig>,
    time: Option<TimeConfig>,
    statistics: ServiceStatistics,
    boot: NetworkBoot,
    /// Number of the cycle of the Adapter in which frames were received last; the first one is 1.
    last_cycle: u64,
}

impl Network {
    /// Creates a network without nodes.
    pub fn new(config: NetworkConfig) -> Self {
        Self {
            config,
            nodes: NodeTable::default(),
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
            if !guarding.is_valid() {
                return Err(NetworkError::Guarding { address, guarding });
            }
            if !config.heartbeat_timeout.is_zero() {
                return Err(NetworkError::HeartbeatAndGuarding { address });
            }
        }
        self.nodes.add_node(address, config, self.config.nmt_queue, self.sync.is_some())
    }

    /// Adds a channel that may have no node yet, for LSS and NMT. [`add_node`](Self::add_node) adds the channel of
    /// its node. SYNC, TIME and the host's heartbeat are sent only on channels that have a node. Allocates; call it
    /// before the cycle.
    ///
    /// # Errors
    /// [`NetworkError::NoChannel`].
    pub fn add_channel(&mut self, slave: usize, channel: u8) -> Result<(), NetworkError> {
        if usize::from(channel) >= CHANNELS {
            return Err(NetworkError::NoChannel { slave, channel });
        }
        self.nodes.ensure_channel(slave, channel, self.config.nmt_queue);
        Ok(())
    }

    /// Returns whether the network has a channel. Real-time safe.
    pub fn has_channel(&self, slave: usize, channel: u8) -> bool {
        self.nodes.channel(slave, channel).is_some()
    }

    /// All nodes, in the order in which they were added.
    pub fn handles(&self) -> impl ExactSizeIterator<Item = NodeHandle> + use<> {
        (0..self.nodes.nodes().len()).map(NodeHandle)
    }

    /// Address of a node.
    pub fn address(&self, handle: NodeHandle) -> Option<NodeAddress> {
        self.nodes.node(handle).map(|node| node.address)
    }

    /// The node at an address; real-time safe.
    pub fn find(&self, address: NodeAddress) -> Option<NodeHandle> {
        self.nodes.find(address.slave, address.channel, address.node)
    }

    pub(super) fn member(&mut self, handle: NodeHandle) -> Option<Member<'_>> {
        self.nodes.member(handle)
    }

    // Cycle

    /// Takes the received frames of the cycle: boot-up messages, heartbeats, guarding responses, emergency messages
    /// and SDO answers of its nodes, and the responses to LSS commands. Passes everything else to `other`, in order: the nodes' TPDOs with slave,
    /// channel and CAN ID, frames of unknown nodes, and transmit reports. Then checks timeouts and the
    /// sessions of the gateways, and executes the boot-up of its nodes.
    ///
    /// Call once per cycle, before anything is sent. A further call in a cycle only takes the frames that are left: a
    /// SYNC period begins once. Real-time safe if `other` is.
    /// [`Port::cycle_report`](ecan_mcan_port::Port::cycle_report) shows whether the cycle was complete.
    pub fn receive(&mut self, cycle: &mut Cycle<'_>, now_ns: u64, mut other: impl FnMut(Received)) {
        self.watch_gateways(cycle);
        for item in cycle.received() {
            match item.to_owned() {
                Received::Frame(frame) if self.take(&frame, now_ns) => {}
                item => other(item),
            }
        }
        let number = cycle.adapter().cycle_number();
        if std::mem::replace(&mut self.last_cycle, number) != number {
            self.tick(now_ns);
            self.boot.step(&mut self.nodes, now_ns);
        }
    }

    /// Sends NMT commands, the host's heartbeat, TIME, guarding requests, LSS and SDO frames that are due, in this
    /// order on each channel.
    ///
    /// Call once per cycle, after the cycle's process data. A frame that finds no space waits for the next
    /// cycle and is not duplicated. Real-time safe.
    pub fn send(&mut self, cycle: &mut Cycle<'_>, now_ns: u64) {
        self.send_to(cycle, now_ns);
    }

    /// Executes the network's part of one cycle: receives, calls `work`, then sends SYNC and
    /// service frames. Real-time safe if `work` is.
    pub fn serve<T>(
        &mut self,
        cycle: &mut Cycle<'_>,
        now_ns: u64,
        work: impl FnOnce(&mut Self) -> T,
    ) -> T {
        self.receive(cycle, now_ns, |_| {});
        let result = work(self);
        self.send_sync(cycle);
        self.send(cycle, now_ns);
        result
    }

    pub(super) fn watch_gateways(&mut self, sink: &impl FrameSink) {
        self.nodes.watch_gateways(|slave| sink.is_ready(slave));
    }

    /// Takes one frame; returns whether it belongs to the network.
    pub(super) fn take(&mut self, received: &ReceivedFrame, now_ns: u64) -> bool {
        let is_valid = self.nodes.on_frame(received, now_ns);
        self.statistics.malformed += u64::from(is_valid == Some(false));
        is_valid.is_some()
    }

    pub(super) fn tick(&mut self, now_ns: u64) {
        self.nodes.tick(self.sync.as_ref(), now_ns);
    }

    pub(super) fn send_to(&mut self, sink: &mut impl FrameSink, now_ns: u64) {
        let Self { config, nodes, time, statistics, .. } = self;
        let (channels, nodes) = nodes.channels_with_nodes();
        for channel in channels {
            let mut sender = ServiceSender { sink, channel, nodes, config, statistics };
            sender.deliver(time.as_ref(), now_ns);
        }
    }

    /// Counters; real-time safe.
    pub fn statistics(&self) -> ServiceStatistics {
        let sdo_strays = self.nodes.nodes().iter().map(|node| node.sdo.strays()).sum();
        let lss_strays = self.nodes.channels().iter().map(|channel| channel.lss.strays()).sum();
        ServiceStatistics { sdo_strays, lss_strays, ..self.statistics }
    }

    // Node state

    /// Status of a node; real-time safe.
    #[inline]
    pub fn status(&self, handle: NodeHandle) -> Option<NodeStatus> {
        self.nodes.node(handle).map(Node::status)
    }

    /// NMT state that a node reported last; `None` before the first report, and after a reset
    /// command until its boot-up message. Real-time safe.
    pub fn nmt_state(&self, handle: NodeHandle) -> Option<NmtState> {
        self.nodes.node(handle)?.nmt.reported()
    }

    /// State of a node's life sign, by heartbeat or guarding; real-time safe.
    pub fn heartbeat(&self, handle: NodeHandle) -> Heartbeat {
        self.nodes.node(handle).map_or(Heartbeat::Unconfigured, Node::life)
    }

    /// Watches a node's heartbeat with another timeout from now on, and ends guarding; zero stops watching
    /// heartbeats and does not change guarding. Real-time safe.
    pub fn set_heartbeat_timeout(&mut self, handle: NodeHandle, timeout: Duration) {
        if let Some(node) = self.nodes.node_mut(handle) {
            node.set_heartbeat_timeout(timeout);
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
        match (self.nodes.node_mut(handle), guarding) {
            (Some(node), Some(guarding)) if !guarding.is_valid() => {
                Err(NetworkError::Guarding { address: node.address, guarding })
            }
            (Some(node), guarding) => {
                node.set_guarding(guarding);
                Ok(())
            }
            (None, _) => Ok(()),
        }
    }

    /// Emergency messages of a node; real-time safe.
    pub fn emcy(&self, handle: NodeHandle) -> Option<&EmcyLog> {
        self.nodes.node(handle).map(|node| &node.emcy)
    }

    // NMT

    /// Queues an NMT command for one node; [`send`](Self::send) sends it before any SDO frame of
    /// its channel. It waits while the channel accepts no frames, for example in bus-off, and is
    /// dropped when the gateway is lost. Real-time safe.
    ///
    /// # Errors
    /// An [`NmtError`].
    pub fn nmt(&mut self, handle: NodeHandle, command: NmtCommand) -> Result<(), NmtError> {
        let mut member = self.nodes.member(handle).ok_or(NmtError::UnknownNode)?;
        if member.queue_nmt(command) {
            return Ok(());
        }
        let NodeAddress { slave, channel, .. } = member.node.address;
        Err(NmtError::QueueFull { slave, channel })
    }

    /// Queues an NMT command to all nodes, as one broadcast per channel of the network. It also
    /// reaches nodes that were not added. Real-time safe.
    ///
    /// # Errors
    /// [`NmtError::QueueFull`]; then it is sent to no channel.
    pub fn nmt_all(&mut self, command: NmtCommand) -> Result<(), NmtError> {
        if let Some(full) = self.nodes.channels().iter().find(|channel| channel.nmt_is_full()) {
            return Err(NmtError::QueueFull { slave: full.slave, channel: full.channel });
        }
        for channel in self.nodes.channels_mut() {
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
        let entry = self.nodes.channel_mut(slave, channel);
        let entry = entry.ok_or(NmtError::UnknownChannel { slave, channel })?;
        let queued = entry.queue_nmt(NmtRequest { command, node: None });
        if queued { Ok(()) } else { Err(NmtError::QueueFull { slave, channel }) }
    }

    /// Returns whether NMT commands wait to be sent; real-time safe.
    pub fn nmt_is_pending(&self) -> bool {
        self.nodes.channels().iter().any(|channel| channel.next_nmt().is_some())
    }

    /// Withholds SYNC, the host's heartbeat and guarding requests on a channel, or sends them again: nodes that watch
    /// the host are not kept alive while their state is unknown. Ignores a channel without nodes.
    /// Real-time safe.
    pub fn set_paused(&mut self, slave: usize, channel: u8, is_paused: bool) {
        if let Some(channel) = self.nodes.channel_mut(slave, channel) {
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
        if let Some(config) = config.filter(|config| !config.is_valid()) {
            return Err(NetworkError::TimeReference { unix_ns: config.reference.unix_ns });
        }
        self.time = config;
        for channel in self.nodes.channels_mut() {
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
        self.nodes
            .node_mut(handle)
            .ok_or(SdoStartError::UnknownNode)?
            .sdo
            .start_upload(index, subindex)
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
        self.nodes
            .node_mut(handle)
            .ok_or(SdoStartError::UnknownNode)?
            .sdo
            .start_block_upload(index, subindex)
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
        self.nodes
            .node_mut(handle)
            .ok_or(SdoStartError::UnknownNode)?
            .sdo
            .start_download(index, subindex, data)
    }

    /// Cancels the transfer with a node and sends the node an abort. Real-time safe.
    pub fn cancel_sdo(&mut self, handle: NodeHandle) {
        if let Some(node) = self.nodes.node_mut(handle) {
            node.sdo.cancel();
        }
    }

    /// Number of SDO requests to a node that timed out, including those that a repetition then
    /// completed. Real-time safe.
    pub fn sdo_silences(&self, handle: NodeHandle) -> u64 {
        self.nodes.node(handle).map_or(0, |node| node.sdo.silences())
    }

    /// State of the transfer with a node; real-time safe.
    pub fn sdo_state(&self, handle: NodeHandle) -> Sdo {
        self.nodes.node(handle).map_or(Sdo::Idle, |node| node.sdo.state())
    }

    /// Value of the last successful transfer with a node, until the next one starts; real-time
    /// safe.
    pub fn sdo_data(&self, handle: NodeHandle) -> &[u8] {
        self.nodes.node(handle).map_or(&[], |node| node.sdo.data())
    }

    /// Failure of the last transfer with a node; real-time safe.
    pub fn sdo_failure(&self, handle: NodeHandle) -> Option<SdoFailure> {
        let node = self.nodes.node(handle)?;
        let Sdo::Failed(fault) = node.sdo.state() else { return None };
        let (direction, index, subindex) = node.sdo.subject();
        Some(SdoFailure { address: node.address, direction, index, subindex, fault })
    }

    /// Number of transfers that were started with a node: a change shows that another part of the
    /// application has used its SDO client. Real-time safe.
    pub fn sdo_generation(&self, handle: NodeHandle) -> u64 {
        self.nodes.node(handle).map_or(0, |node| node.sdo.generation())
    }

    // LSS

    /// Starts an LSS command on a channel. Real-time safe; [`lss_state`](Self::lss_state) reports its end in a later
    /// cycle. At most one LSS frame is sent per cycle and channel.
    ///
    /// # Errors
    /// An [`LssStartError`].
    pub fn start_lss(
        &mut self,
        slave: usize,
        channel: u8,
        command: LssCommand,
    ) -> Result<(), LssStartError> {
        let entry = self.nodes.channel_mut(slave, channel);
        let entry = entry.ok_or(LssStartError::UnknownChannel { slave, channel })?;
        if entry.lss.start(command) { Ok(()) } else { Err(LssStartError::Busy { slave, channel }) }
    }

    /// State of the LSS master of a channel; [`Lss::Idle`] for a channel that the network does not have. Real-time
    /// safe.
    pub fn lss_state(&self, slave: usize, channel: u8) -> Lss {
        self.nodes.channel(slave, channel).map_or(Lss::Idle, |channel| channel.lss.state())
    }

    /// Failure of the last LSS command of a channel. Real-time safe.
    pub fn lss_failure(&self, slave: usize, channel: u8) -> Option<LssFailure> {
        let master = &self.nodes.channel(slave, channel)?.lss;
        let Lss::Failed(fault) = master.state() else { return None };
        Some(LssFailure { slave, channel, command: master.command(), fault })
    }

    /// Cancels the LSS command of a channel. The state of the slaves is then unknown. Real-time safe.
    pub fn cancel_lss(&mut self, slave: usize, channel: u8) {
        if let Some(channel) = self.nodes.channel_mut(slave, channel) {
            channel.lss.cancel(LssFault::Cancelled);
        }
    }

    /// Sets the waiting times of the LSS master of a channel. Ignores a channel that the network does not have.
    /// Real-time safe.
    pub fn set_lss_config(&mut self, slave: usize, channel: u8, config: LssConfig) {
        if let Some(channel) = self.nodes.channel_mut(slave, channel) {
            channel.lss.set_config(config);
        }
    }

    // Parameters and boot-up

    /// Parameters that [`NodeAction::WriteParameters`](crate::NodeAction::WriteParameters) writes to
    /// a node; none if the set is empty. Allocates.
    pub fn set_parameters(&mut self, handle: NodeHandle, set: Arc<ParameterSet>) {
        if let Some(node) = self.nodes.node_mut(handle) {
            node.set_parameters(set);
        }
    }

    /// Boots a node from the next cycle on, as CiA 302-2 specifies: reset, response, identity,
    /// software, default parameters, parameters with readback, PDOs, heartbeat, start. All nodes of
    /// all channels boot in parallel. Replaces an earlier configuration. Allocates; the cycle does
    /// not.
    ///
    /// A node whose configuration date 0x1020 is the expected one keeps its parameters. While it
    /// boots, its SDO client belongs to the boot-up; if the application starts a transfer in between,
    /// the boot-up waits. A node that fails does not stop the others. A boot-up message of a node
    /// that is booted or failed starts its boot-up again: it restarted, was switched on late, or was
    /// replaced.
    ///
    /// Nodes with an axis are configured by the axis table, not here.
    pub fn boot(&mut self, handle: NodeHandle, config: BootConfig) {
        self.boot.add(&mut self.nodes, handle, config);
    }

    /// Boots a node again, with its configured reset. Real-time safe.
    pub fn boot_again(&mut self, handle: NodeHandle, now_ns: u64) {
        self.boot.restart(&mut self.nodes, handle, now_ns);
    }

    /// State of the boot-up of all nodes; [`BootState::Booted`] without any. Real-time safe.
    pub fn boot_state(&self) -> BootState {
        self.boot.state()
    }

    /// Progress of each boot-up, in the order of the calls of [`boot`](Self::boot); real-time safe.
    pub fn boot_progress(&self, now_ns: u64) -> impl Iterator<Item = BootProgress> + '_ {
        self.boot.progress(now_ns)
    }

    /// Progress of the boot-up of a node; real-time safe.
    pub fn boot_progress_of(&self, handle: NodeHandle, now_ns: u64) -> Option<BootProgress> {
        self.boot.progress_of(handle, now_ns)
    }

    // SYNC

    /// Starts, changes or stops the production of SYNC on every channel that has a node. Counters restart;
    /// the first SYNC is due in the next cycle. Real-time safe.
    ///
    /// # Errors
    /// [`NetworkError::CounterOverflow`]; nothing is changed.
    pub fn set_sync(&mut self, config: Option<SyncConfig>) -> Result<(), NetworkError> {
        if let Some(value) = config.and_then(|config| config.counter_overflow)
            && !(2..=240).contains(&value)
        {
            return Err(NetworkError::CounterOverflow { value });
        }
        self.sync = config;
        for channel in self.nodes.channels_mut() {
            channel.sync.enable(config.is_some() && !channel.nodes.is_empty());
        }
        Ok(())
    }

    /// Configuration of SYNC; `None` if it is off.
    pub fn sync(&self) -> Option<SyncConfig> {
        self.sync
    }

    /// Sends the SYNC messages that are due, after the targets of the cycle: a channel sends in the order in
    /// which it received frames. A SYNC that finds no space, or whose gateway's last image is unconfirmed
    /// ([`CycleReport::is_unconfirmed`](ecan_mcan_port::CycleReport::is_unconfirmed)), is sent in a later
    /// cycle, after the targets of that one, with the next number of the counter; missed ones are not
    /// repeated. Returns the number sent.
    ///
    /// Call once per cycle. Real-time safe.
    pub fn send_sync(&mut self, cycle: &mut Cycle<'_>) -> usize {
        self.send_sync_to(cycle, |_, _| true)
    }

    /// As [`send_sync`](Self::send_sync), but only to the channels for which `may_send` returns true, by slave
    /// and channel. On the others a SYNC that is due waits for a later cycle. Real-time safe if `may_send` is.
    pub fn send_sync_where(
        &mut self,
        cycle: &mut Cycle<'_>,
        may_send: impl FnMut(usize, u8) -> bool,
    ) -> usize {
        self.send_sync_to(cycle, may_send)
    }

    /// Returns whether [`send_sync`](Self::send_sync) sends a SYNC to a channel in this cycle, if it finds space: one
    /// is due, and the gateway is ready and has confirmed its last image. Real-time safe.
    pub fn sync_is_due(&self, cycle: &Cycle<'_>, slave: usize, channel: u8) -> bool {
        let entry = self.nodes.channel(slave, channel);
        entry.is_some_and(|entry| entry.sync.is_due() && !entry.is_paused)
            && cycle.is_ready(slave)
            && !cycle.is_unconfirmed(slave)
    }

    /// Returns whether a SYNC period begins in this cycle, on all channels alike. A late SYNC is due in other cycles,
    /// too. Real-time safe.
    pub fn sync_period_begins(&self) -> bool {
        self.nodes.channels().iter().any(|channel| channel.sync.is_planned())
    }

    /// Returns whether a SYNC was sent to a channel in this cycle. Real-time safe.
    pub fn has_sent_sync(&self, slave: usize, channel: u8) -> bool {
        self.nodes.channel(slave, channel).is_some_and(|channel| channel.sync.is_sent())
    }

    pub(super) fn send_sync_to(
        &mut self,
        sink: &mut impl FrameSink,
        mut may_send: impl FnMut(usize, u8) -> bool,
    ) -> usize {
        let Self { config, nodes, sync, statistics, .. } = self;
        let Some(sync) = sync else { return 0 };
        let (channels, nodes) = nodes.channels_with_nodes();
        let before = statistics.syncs_sent;
        for channel in channels {
            if channel.sync.is_due() && !may_send(channel.slave, channel.channel) {
                statistics.syncs_late += 1;
                continue;
            }
            ServiceSender { sink, channel, nodes, config, statistics }.send_sync(sync);
        }
        usize::try_from(statistics.syncs_sent - before).unwrap_or(usize::MAX)
    }
}
