//! What an analyser on a bus would have recorded.

use ecan_protocol::CanFrame;

use crate::bus::{BusEvent, StationId};
use crate::world::World;

/// A frame that went out on a bus and was acknowledged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusFrame {
    /// Start of frame, in nanoseconds of simulated time.
    pub start_ns: u64,
    /// End of frame, in nanoseconds of simulated time.
    pub end_ns: u64,
    /// The frame as it was on the wire.
    pub frame: CanFrame,
    /// Whether the gateway's channel sent it that the recording was started for.
    pub is_from_channel: bool,
}

/// A recording under way.
pub(super) struct Recording {
    bus: usize,
    station: StationId,
    frames: Vec<BusFrame>,
}

impl Recording {
    pub(super) fn note(&mut self, bus: usize, event: &BusEvent) {
        let BusEvent::Transmitted { station, frame, start_ns, at_ns } = event else { return };
        if bus == self.bus {
            self.frames.push(BusFrame {
                start_ns: *start_ns,
                end_ns: *at_ns,
                frame: *frame,
                is_from_channel: *station == self.station,
            });
        }
    }
}

impl World {
    /// Records from now on every frame on the bus that a gateway's channel is on, in place of a
    /// recording under way. False where there is no such channel. A recording takes memory for
    /// each frame until it is fetched.
    pub fn record_bus_of(&mut self, gateway: usize, channel: usize) -> bool {
        let link = self.slots.get(gateway).and_then(|slot| slot.links.get(channel));
        self.recording =
            link.map(|link| Recording { bus: link.bus, station: link.station, frames: Vec::new() });
        self.recording.is_some()
    }

    /// Fetches what was recorded since the last call, in the order of the bus, and goes on
    /// recording. Empty where nothing is recorded.
    pub fn take_recorded(&mut self) -> Vec<BusFrame> {
        self.recording.as_mut().map(|it| std::mem::take(&mut it.frames)).unwrap_or_default()
    }
}
