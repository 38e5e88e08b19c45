//! Counters of a bridge.

use std::sync::atomic::{AtomicU64, Ordering};

/// What a bridge has done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BridgeStatistics {
    /// Clients connected now.
    pub clients: usize,
    /// Clients that have connected so far, those turned away not counted.
    pub connections: u64,
    /// Clients turned away because there were too many.
    pub turned_away: u64,
    /// Frames of clients that went over the bus.
    pub sent: u64,
    /// Frames of clients that were refused because too many waited for the bus.
    pub dropped_to_bus: u64,
    /// Frames of clients that were refused or dropped because the bus took none, for instance while
    /// it was out of service.
    pub not_taken: u64,
    /// Frames put into a client's queue, those that it did not want to hear included.
    pub delivered: u64,
    /// Frames that did not fit into a client's queue.
    pub dropped_to_clients: u64,
    /// Commands and frames of clients that were refused: malformed, unknown, at the wrong time, or
    /// for one of the reasons that are counted by themselves.
    pub refused: u64,
    /// Frames of clients that were refused because of the bit rate that the client named, or
    /// because a CAN FD frame was meant for a classic bus.
    pub mismatched: u64,
    /// Frames of the bus that the other side cannot carry: CAN FD on a classic CAN interface.
    pub unfit: u64,
}

/// The same, counted by several threads.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) connections: AtomicU64,
    pub(crate) turned_away: AtomicU64,
    pub(crate) sent: AtomicU64,
    pub(crate) dropped_to_bus: AtomicU64,
    pub(crate) not_taken: AtomicU64,
    pub(crate) delivered: AtomicU64,
    pub(crate) dropped_to_clients: AtomicU64,
    pub(crate) refused: AtomicU64,
    pub(crate) mismatched: AtomicU64,
    pub(crate) unfit: AtomicU64,
}

/// Counts one more. Nothing else hangs on the order.
pub(crate) fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

impl Counters {
    pub(crate) fn read(&self, clients: usize) -> BridgeStatistics {
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        BridgeStatistics {
            clients,
            connections: read(&self.connections),
            turned_away: read(&self.turned_away),
            sent: read(&self.sent),
            dropped_to_bus: read(&self.dropped_to_bus),
            not_taken: read(&self.not_taken),
            delivered: read(&self.delivered),
            dropped_to_clients: read(&self.dropped_to_clients),
            refused: read(&self.refused),
            mismatched: read(&self.mismatched),
            unfit: read(&self.unfit),
        }
    }
}
