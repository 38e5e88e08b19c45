//! Counters of a bridge.

use std::sync::atomic::{AtomicU64, Ordering};

macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// Counters of a bridge.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct BridgeStatistics {
            /// Number of connected clients.
            pub clients: usize,
            $($(#[$doc])* pub $name: u64,)*
        }

        /// The same counters, for several threads.
        #[derive(Debug, Default)]
        pub(crate) struct Counters {
            $(pub(crate) $name: AtomicU64,)*
        }

        impl Counters {
            pub(crate) fn read(&self, clients: usize) -> BridgeStatistics {
                BridgeStatistics { clients, $($name: self.$name.load(Ordering::Relaxed),)* }
            }
        }
    };
}

counters! {
    /// Number of connections, without rejected clients.
    connections,
    /// Number of clients rejected because too many were connected.
    rejected_clients,
    /// Number of connections closed because their client did not open the bus: within the time for
    /// it, or before another client needed the place.
    silent_clients,
    /// Client frames that were sent on the bus.
    sent,
    /// Client frames that were passed to the bus and not sent, or without result.
    failed,
    /// Client frames rejected because the queue to the bus was full.
    dropped_to_bus,
    /// Client frames rejected or discarded because the bus accepted none, for example while the
    /// gateway was not ready.
    discarded,
    /// Frames put into the queue of a client, including those outside its receive settings.
    delivered,
    /// Frames dropped because the queue of a client was full.
    dropped_to_clients,
    /// Commands and frames of clients that were rejected: malformed, unknown, at the wrong time, or
    /// for one of the reasons counted separately.
    rejected,
    /// Client frames rejected because of the client's bit rate, or because a CAN FD frame was for a
    /// classic bus.
    mismatched,
    /// Frames of the bus that the client cannot represent: CAN FD on a classic CAN interface.
    unsupported,
}

pub(crate) fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}
