//! NMT slave, heartbeat producer and consumer.

use ecan_canopen::{HeartbeatConsumer, NmtState, NodeId, object};

use super::dictionary::Dictionary;
use crate::earliest::earliest;

#[derive(Clone, Copy, Debug)]
struct Watch {
    producer: NodeId,
    time_ns: u64,
    /// Time at which it is late; `None` until the first one arrives.
    deadline: Option<u64>,
    lost: bool,
}

#[derive(Clone, Debug)]
pub(super) struct Network {
    pub(super) state: NmtState,
    boot_at: Option<u64>,
    producer_ns: u64,
    heartbeat_at: Option<u64>,
    watches: Vec<Watch>,
}

impl Network {
    pub(super) const fn new() -> Self {
        Self {
            state: NmtState::Initialising,
            boot_at: None,
            producer_ns: 0,
            heartbeat_at: None,
            watches: Vec::new(),
        }
    }

    /// Returns whether SDO, SYNC and EMCY are active.
    pub(super) const fn communicates(&self) -> bool {
        matches!(self.state, NmtState::PreOperational | NmtState::Operational)
    }

    /// Starts booting; with `None` it never ends.
    pub(super) fn boot(&mut self, at: Option<u64>) {
        self.state = NmtState::Initialising;
        self.boot_at = at;
        self.heartbeat_at = None;
        for watch in &mut self.watches {
            watch.deadline = None;
            watch.lost = false;
        }
    }

    pub(super) fn boot_ends(&mut self, now: u64) -> bool {
        self.boot_at.take_if(|at| *at <= now).is_some()
    }

    pub(super) fn load(&mut self, now: u64, objects: &Dictionary) {
        let ms = objects.unsigned16(object::PRODUCER_HEARTBEAT, 0);
        self.producer_ns = ms * 1_000_000;
        self.heartbeat_at = (ms > 0).then(|| now.saturating_add(self.producer_ns));
        self.load_watches(objects);
    }

    /// Reads the monitored heartbeats from the dictionary; an unchanged entry keeps its state.
    pub(super) fn load_watches(&mut self, objects: &Dictionary) {
        let before = std::mem::take(&mut self.watches);
        for subindex in 1..=127 {
            let Some(raw) = objects.number(object::CONSUMER_HEARTBEAT, subindex) else { break };
            let Some(entry) = HeartbeatConsumer::from_raw(raw as u32) else { continue };
            let watch = Watch {
                producer: entry.producer,
                time_ns: u64::from(entry.time_ms) * 1_000_000,
                deadline: None,
                lost: false,
            };
            let same = before
                .iter()
                .find(|old| old.producer == watch.producer && old.time_ns == watch.time_ns);
            self.watches.push(same.copied().unwrap_or(watch));
        }
    }

    /// Returns whether another entry than `subindex` already monitors this node.
    pub(super) fn is_watched(objects: &Dictionary, producer: NodeId, subindex: u8) -> bool {
        (1..=127).filter(|other| *other != subindex).any(|other| {
            objects
                .number(object::CONSUMER_HEARTBEAT, other)
                .and_then(|raw| HeartbeatConsumer::from_raw(raw as u32))
                .is_some_and(|entry| entry.producer == producer)
        })
    }

    /// Receives a heartbeat; returns true if it had been lost.
    pub(super) fn heartbeat_received(&mut self, now: u64, producer: NodeId) -> bool {
        let Some(watch) = self.watches.iter_mut().find(|watch| watch.producer == producer) else {
            return false;
        };
        watch.deadline = Some(now.saturating_add(watch.time_ns));
        std::mem::take(&mut watch.lost)
    }

    /// Returns whether a heartbeat is late that was not lost before.
    pub(super) fn take_late(&mut self, now: u64) -> bool {
        let late = |watch: &&mut Watch| watch.deadline.is_some_and(|at| at <= now);
        let Some(watch) = self.watches.iter_mut().find(late) else { return false };
        watch.deadline = None;
        watch.lost = true;
        true
    }

    pub(super) const fn produces_heartbeats(&self) -> bool {
        self.producer_ns > 0
    }

    pub(super) fn heartbeat_due(&mut self, now: u64) -> bool {
        let Some(at) = self.heartbeat_at.filter(|at| *at <= now) else { return false };
        let period = self.producer_ns.max(1);
        let periods = (now - at) / period + 1;
        self.heartbeat_at = Some(at.saturating_add(periods.saturating_mul(period)));
        true
    }

    pub(super) fn next_event(&self) -> Option<u64> {
        let watches = earliest(self.watches.iter().map(|watch| watch.deadline));
        earliest([self.boot_at, self.heartbeat_at, watches])
    }
}
