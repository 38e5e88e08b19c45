//! Nodes and channels of a network, and the frames that they receive.

use std::collections::VecDeque;

use ecan_mcan_port::ReceivedFrame;
use ecan_protocol::can::FrameKind;

use super::config::{NodeAddress, NodeConfig, NodeHandle, SyncConfig};
use super::error::{NetworkError, SdoFault};
use super::lss::{LssConfig, LssFault, LssMaster};
use super::node::Node;
use super::producers::{PeriodTimer, SyncProducer};
use crate::{CobId, NmtCommand, NmtRequest, NodeId, Service};

/// Node-IDs, 0 included.
const NODE_IDS: usize = 128;

/// State of one CAN channel of the network.
#[derive(Debug)]
pub(super) struct Channel {
    pub(super) slave: usize,
    pub(super) channel: u8,
    is_ready: bool,
    /// Neither SYNC nor the host's heartbeat nor a guarding request is sent.
    pub(super) is_paused: bool,
    pub(super) nodes: Vec<usize>,
    lookup: [Option<u16>; NODE_IDS],
    /// The node that sends first in the next cycle.
    pub(super) turn: usize,
    nmt: VecDeque<NmtRequest>,
    nmt_limit: usize,
    pub(super) heartbeat: PeriodTimer,
    pub(super) time: PeriodTimer,
    /// The node that is guarded first in the next cycle.
    pub(super) guard_turn: usize,
    pub(super) sync: SyncProducer,
    pub(super) lss: LssMaster,
}

impl Channel {
    fn new(slave: usize, channel: u8, nmt_limit: usize) -> Self {
        Self {
            slave,
            channel,
            is_ready: false,
            is_paused: false,
            nodes: Vec::new(),
            lookup: [None; NODE_IDS],
            turn: 0,
            nmt: VecDeque::with_capacity(nmt_limit),
            nmt_limit,
            heartbeat: PeriodTimer::default(),
            time: PeriodTimer::default(),
            guard_turn: 0,
            sync: SyncProducer::default(),
            lss: LssMaster::new(LssConfig::default()),
        }
    }

    fn add_node(&mut self, node: NodeId, nth: u16) {
        self.nodes.push(usize::from(nth));
        if let Some(entry) = self.lookup.get_mut(usize::from(node.get())) {
            *entry = Some(nth);
        }
    }

    fn node(&self, node: NodeId) -> Option<usize> {
        self.lookup.get(usize::from(node.get())).copied().flatten().map(usize::from)
    }

    pub(super) fn nmt_is_full(&self) -> bool {
        self.nmt.len() >= self.nmt_limit
    }

    /// Queues a command; returns whether it was queued.
    pub(super) fn queue_nmt(&mut self, request: NmtRequest) -> bool {
        if self.nmt_is_full() {
            return false;
        }
        self.nmt.push_back(request);
        true
    }

    pub(super) fn next_nmt(&self) -> Option<NmtRequest> {
        self.nmt.front().copied()
    }

    /// Removes the command that was sent.
    pub(super) fn pop_nmt(&mut self) {
        self.nmt.pop_front();
    }

    /// Drops what waits for a gateway that was lost: pending commands are obsolete.
    fn on_gateway_lost(&mut self) {
        self.nmt.clear();
        self.heartbeat.reset();
        self.time.reset();
        self.lss.cancel(LssFault::GatewayLost);
    }
}

/// A node with its channel.
#[derive(Debug)]
pub(super) struct Member<'a> {
    pub(super) node: &'a mut Node,
    channel: &'a mut Channel,
}

impl Member<'_> {
    /// Queues an NMT command for the node; returns `false` if the queue of its channel is full.
    pub(super) fn queue_nmt(&mut self, command: NmtCommand) -> bool {
        let node = Some(self.node.address.node);
        self.channel.queue_nmt(NmtRequest { command, node })
    }
}

/// The nodes of a network and their channels.
#[derive(Debug, Default)]
pub(super) struct NodeTable {
    nodes: Vec<Node>,
    channels: Vec<Channel>,
}

impl NodeTable {
    /// Adds a node that the table does not have, and its channel.
    pub(super) fn add_node(
        &mut self,
        address: NodeAddress,
        config: NodeConfig,
        nmt_queue: usize,
        has_sync: bool,
    ) -> Result<NodeHandle, NetworkError> {
        let nth = self.nodes.len();
        let short = u16::try_from(nth).map_err(|_| NetworkError::TooMany)?;
        let at = self.ensure_channel(address.slave, address.channel, nmt_queue);
        self.nodes.push(Node::new(address, at, config));
        if let Some(channel) = self.channels.get_mut(at) {
            if channel.nodes.is_empty() {
                channel.sync.enable(has_sync);
            }
            channel.add_node(address.node, short);
        }
        Ok(NodeHandle(nth))
    }

    /// Index of a channel; adds it if the table does not have it.
    pub(super) fn ensure_channel(&mut self, slave: usize, channel: u8, nmt_queue: usize) -> usize {
        self.channel_index(slave, channel).unwrap_or_else(|| {
            self.channels.push(Channel::new(slave, channel, nmt_queue));
            self.channels.len() - 1
        })
    }

    fn channel_index(&self, slave: usize, channel: u8) -> Option<usize> {
        self.channels.iter().position(|own| (own.slave, own.channel) == (slave, channel))
    }

    pub(super) fn channel(&self, slave: usize, channel: u8) -> Option<&Channel> {
        self.channels.get(self.channel_index(slave, channel)?)
    }

    pub(super) fn channel_mut(&mut self, slave: usize, channel: u8) -> Option<&mut Channel> {
        let nth = self.channel_index(slave, channel)?;
        self.channels.get_mut(nth)
    }

    pub(super) fn channels(&self) -> &[Channel] {
        &self.channels
    }

    pub(super) fn channels_mut(&mut self) -> &mut [Channel] {
        &mut self.channels
    }

    /// Each channel, with all nodes of the network.
    pub(super) fn channels_with_nodes(&mut self) -> (&mut [Channel], &mut [Node]) {
        (&mut self.channels, &mut self.nodes)
    }

    pub(super) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    #[inline]
    pub(super) fn node(&self, handle: NodeHandle) -> Option<&Node> {
        self.nodes.get(handle.0)
    }

    pub(super) fn node_mut(&mut self, handle: NodeHandle) -> Option<&mut Node> {
        self.nodes.get_mut(handle.0)
    }

    pub(super) fn member(&mut self, handle: NodeHandle) -> Option<Member<'_>> {
        let node = self.nodes.get_mut(handle.0)?;
        let channel = self.channels.get_mut(node.channel)?;
        Some(Member { node, channel })
    }

    pub(super) fn find(&self, slave: usize, channel: u8, node: NodeId) -> Option<NodeHandle> {
        self.channel(slave, channel)?.node(node).map(NodeHandle)
    }

    /// Drops the transfers and commands of a gateway that is no longer ready.
    pub(super) fn watch_gateways(&mut self, is_ready: impl Fn(usize) -> bool) {
        let Self { channels, nodes } = self;
        for channel in channels {
            let is_ready = is_ready(channel.slave);
            if channel.is_ready && !is_ready {
                channel.on_gateway_lost();
                for nth in &channel.nodes {
                    if let Some(node) = nodes.get_mut(*nth) {
                        node.sdo.drop_transfer(SdoFault::GatewayLost);
                    }
                }
            }
            channel.is_ready = is_ready;
        }
    }

    /// Processes a frame of a node or of an LSS slave. Returns whether CiA 301 allows it; `None` for a frame that does
    /// not belong to the network.
    pub(super) fn on_frame(&mut self, received: &ReceivedFrame, now_ns: u64) -> Option<bool> {
        let frame = &received.frame;
        let (slave, channel, data) = (received.slave, received.channel, frame.data());
        let service = CobId::classify(frame.id())?;
        let (Service::Emcy(node) | Service::SdoServer(node) | Service::Heartbeat(node)) = service
        else {
            if service == Service::LssResponse {
                self.channel_mut(slave, channel)?.lss.receive(data);
                return Some(true);
            }
            return None;
        };
        let handle = self.find(slave, channel, node)?;
        let node = self.node_mut(handle)?;
        // A service is data; a request for it is a fault of another master.
        if frame.kind() != FrameKind::Data {
            return Some(false);
        }
        Some(match service {
            Service::Emcy(_) => node.on_emcy(data, now_ns),
            Service::Heartbeat(_) => node.on_error_control(data, now_ns),
            _ => {
                node.sdo.receive(data, now_ns);
                true
            }
        })
    }

    /// Checks the waiting times of all nodes and channels, and begins the SYNC periods.
    pub(super) fn tick(&mut self, sync: Option<&SyncConfig>, now_ns: u64) {
        for node in &mut self.nodes {
            node.tick(now_ns);
        }
        for channel in &mut self.channels {
            channel.lss.tick(now_ns);
            if let Some(sync) = sync {
                channel.sync.tick(sync);
            }
        }
    }
}
