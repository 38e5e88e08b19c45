//! The clients of a bridge, as seen by the owner of the bus.

use std::sync::Arc;

use ecan_protocol::can::CanFrame;

use crate::hub::{ClientId, Hub};
use crate::rates::BusRates;
use crate::statistics::{BridgeStatistics, count};

/// The clients of one bridge. A clone refers to the same clients. No method blocks.
#[derive(Clone, Debug)]
pub struct Clients(pub(crate) Arc<Hub>);

impl Clients {
    /// Sets the bit rates of the bus.
    pub fn set_bus(&self, rates: BusRates) {
        self.0.set_bus(rates);
    }

    /// Sets whether the bus accepts frames of clients; by default it does. While it does not, new
    /// frames are rejected and waiting frames are discarded, because they would be stale later.
    /// Returns the number of frames discarded by this call.
    pub fn set_accepting(&self, is_accepting: bool) -> usize {
        self.0.set_accepting(is_accepting)
    }

    /// Returns whether a client is connected.
    pub fn is_any_connected(&self) -> bool {
        self.0.has_clients()
    }

    /// Takes the next frame of a client for the bus, with the client.
    pub fn next_for_bus(&self) -> Option<(ClientId, CanFrame)> {
        self.0.next_for_bus()
    }

    /// Counts a client frame that was sent on the bus.
    pub fn count_sent(&self) {
        count(&self.0.counters.sent);
    }

    /// Passes a frame of the bus to every client except its sender, with its end time in
    /// nanoseconds of the bus's clock.
    pub fn deliver(&self, frame: &CanFrame, time_ns: u64, sender: Option<ClientId>) {
        self.0.deliver(frame, time_ns, sender);
    }

    /// Counters of the bridge.
    pub fn statistics(&self) -> BridgeStatistics {
        self.0.statistics()
    }
}
