//! The clients of a bridge, as the one who has the bus sees them.

use std::sync::Arc;

use ecan_protocol::can::CanFrame;

use crate::hub::{ClientId, Hub};
use crate::rates::BusRates;
use crate::statistics::{BridgeStatistics, count};

/// The clients of one bridge. Clones are the same ones. Nothing here blocks.
#[derive(Clone, Debug)]
pub struct Clients(pub(crate) Arc<Hub>);

impl Clients {
    /// Tells them the bit rates of the bus.
    pub fn set_bus(&self, rates: BusRates) {
        self.0.set_bus(rates);
    }

    /// Whether the bus takes frames of clients, which at first it does. While it does not, new frames
    /// are refused, and those that wait are dropped: later they would be old. Gives the number of
    /// frames that were dropped now.
    pub fn set_taking(&self, is_taking: bool) -> usize {
        self.0.set_taking(is_taking)
    }

    /// Whether there is any.
    pub fn are_there(&self) -> bool {
        self.0.has_clients()
    }

    /// The next frame that one of them wants on the bus, with the client.
    pub fn next_for_bus(&self) -> Option<(ClientId, CanFrame)> {
        self.0.next_for_bus()
    }

    /// A client's frame went over the bus.
    pub fn count_sent(&self) {
        count(&self.0.counters.sent);
    }

    /// Hands a frame of the bus to every client but its sender, with the time at which it was
    /// complete in nanoseconds of the bus's clock.
    pub fn deliver(&self, frame: &CanFrame, time_ns: u64, sender: Option<ClientId>) {
        self.0.deliver(frame, time_ns, sender);
    }

    /// What the bridge has done so far.
    pub fn statistics(&self) -> BridgeStatistics {
        self.0.statistics()
    }
}
