//! Counters of a bridge.

use std::sync::atomic::{AtomicU64, Ordering};

/// Counters of a bridge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BridgeStatistics {
    /// Number of connected clients.
    pub clients: usize,
    /// Number of connections, without rejected clients.
    pub connections: u64,
    /// Number of clients rejected because too many were connected.
    pub rejected_clients: u64,
    /// Client frames that were sent on the bus.
    pub sent: u64,
    /// Client frames rejected because the queue to the bus was full.
    pub dropped_to_bus: u64,
    /// Client frames rejected or discarded because the bus accepted none, for example while the
    /// gateway was not ready.
    pub discarded: u64,
    /// Frames put into the queue of a client, including those outside its receive settings.
    pub delivered: u64,
    /// Frames dropped because the queue of a client was full.
    pub dropped_to_clients: u64,
    /// Commands and frames of clients that were rejected: malformed, unknown, at the wrong time, or
    /// for one of the reasons counted separately.
    pub rejected: u64,
    /// Client frames rejected because of the client's bit rate, or because a CAN FD frame was for a
    /// classic bus.
    pub mismatched: u64,
    /// Frames of the bus that the client cannot represent: CAN FD on a classic CAN interface.
    pub unsupported: u64,
}

/// The same counters, for several threads.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) connections: AtomicU64,
    pub(crate) rejected_clients: AtomicU64,
    pub(crate) sent: AtomicU64,
    pub(crate) dropped_to_bus: AtomicU64,
    pub(crate) discarded: AtomicU64,
    pub(crate) delivered: AtomicU64,
    pub(crate) dropped_to_clients: AtomicU64,
    pub(crate) rejected: AtomicU64,
    pub(crate) mismatched: AtomicU64,
    pub(crate) unsupported: AtomicU64,
}

/// Adds one. The order is irrelevant.
pub(crate) fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

impl Counters {
    pub(crate) fn read(&self, clients: usize) -> BridgeStatistics {
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        BridgeStatistics {
            clients,
            connections: read(&self.connections),
            rejected_clients: read(&self.rejected_clients),
            sent: read(&self.sent),
            dropped_to_bus: read(&self.dropped_to_bus),
            discarded: read(&self.discarded),
            delivered: read(&self.delivered),
            dropped_to_clients: read(&self.dropped_to_clients),
            rejected: read(&self.rejected),
            mismatched: read(&self.mismatched),
            unsupported: read(&self.unsupported),
        }
    }
}
