//! What an analyser on a bus would have recorded.

use ecan_protocol::can::CanFrame;

use crate::bus::{BusEvent, StationId};
use crate::world::World;
use crate::world::can_side::Owner;

/// A frame that went out on a bus and was acknowledged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusFrame {
    /// Start of frame, in nanoseconds of simulated time.
    pub start_ns: u64,
    /// End of frame, in nanoseconds of simulated time.
    pub end_ns: u64,
    /// The frame as it was on the wire.
    pub frame: CanFrame,
    /// Whether the gateway's channel sent it that the recording was started for; in a recording of
    /// all buses, whether any gateway's channel did.
    pub is_from_channel: bool,
}

/// What is recorded.
enum Scope {
    /// The bus of one channel.
    Channel { bus: usize, station: StationId },
    /// Every bus.
    All,
}

/// A recording under way.
pub(super) struct Recording {
    scope: Scope,
    /// Each with its bus.
    frames: Vec<(usize, BusFrame)>,
}

impl Recording {
    fn new(scope: Scope) -> Self {
        Self { scope, frames: Vec::new() }
    }

    /// Notes what happened on a bus; `owners` are those of its stations.
    pub(super) fn note(&mut self, bus: usize, owners: &[Owner], event: &BusEvent) {
        let BusEvent::Transmitted { station, frame, start_ns, at_ns } = event else { return };
        let is_from_channel = match self.scope {
            Scope::Channel { bus: recorded, .. } if recorded != bus => return,
            Scope::Channel { station: channel, .. } => *station == channel,
            Scope::All => matches!(owners.get(station.index()), Some(Owner::Channel { .. })),
        };
        let (start_ns, end_ns) = (*start_ns, *at_ns);
        self.frames.push((bus, BusFrame { start_ns, end_ns, frame: *frame, is_from_channel }));
    }
}

impl World {
    /// Records from now on every frame on the bus that a gateway's channel is on, in place of a
    /// recording under way. False where there is no such channel. A recording takes memory for
    /// each frame until it is fetched.
    pub fn record_bus_of(&mut self, gateway: usize, channel: usize) -> bool {
        let link = self.slots.get(gateway).and_then(|slot| slot.links.get(channel));
        let scope = link.map(|link| Scope::Channel { bus: link.bus, station: link.station });
        self.recording = scope.map(Recording::new);
        self.recording.is_some()
    }

    /// Records from now on every frame on every bus, in place of a recording under way. A recording
    /// takes memory for each frame until it is fetched.
    pub fn record_all_buses(&mut self) {
        self.recording = Some(Recording::new(Scope::All));
    }

    /// Fetches what was recorded since the last call, in the order of the bus, and goes on
    /// recording. Empty where nothing is recorded.
    pub fn take_recorded(&mut self) -> Vec<BusFrame> {
        let frames = self.recording.as_mut().map(|it| std::mem::take(&mut it.frames));
        frames.unwrap_or_default().into_iter().map(|(_, frame)| frame).collect()
    }

    /// The same with the name of the bus for each frame, in the order in which they ended; keeps the
    /// memory for those to come.
    pub fn drain_recorded(&mut self, mut take: impl FnMut(&str, &BusFrame)) {
        let Some(recording) = &mut self.recording else { return };
        for (bus, frame) in recording.frames.drain(..) {
            if let Some(slot) = self.buses.get(bus) {
                take(slot.bus.name(), &frame);
            }
        }
    }
}
