//! State of one CAN channel of the network.

use std::collections::VecDeque;

use crate::{NmtRequest, NodeId};

use super::lss::{LssConfig, LssFault, LssMaster};
use super::period_timer::PeriodTimer;
use super::sync_producer::SyncProducer;

/// Node-IDs, 0 included.
const NODE_IDS: usize = 128;

#[derive(Debug)]
pub(super) struct Channel {
    pub(super) slave: usize,
    pub(super) channel: u8,
    pub(super) is_ready: bool,
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
    pub(super) fn new(slave: usize, channel: u8, nmt_limit: usize) -> Self {
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

    pub(super) fn add_node(&mut self, node: NodeId, nth: u16) {
        self.nodes.push(usize::from(nth));
        if let Some(entry) = self.lookup.get_mut(usize::from(node.get())) {
            *entry = Some(nth);
        }
    }

    pub(super) fn node(&self, node: NodeId) -> Option<usize> {
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

    pub(super) fn nmt_sent(&mut self) {
        self.nmt.pop_front();
    }

    /// The gateway was lost: pending commands are obsolete.
    pub(super) fn gateway_lost(&mut self) {
        self.nmt.clear();
        self.heartbeat.reset();
        self.time.reset();
        self.lss.cancel(LssFault::GatewayLost);
    }
}
