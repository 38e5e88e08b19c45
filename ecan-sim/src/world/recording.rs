use ecan_protocol::can::CanFrame;

use crate::bus::{Broadcast, BusEvent, StationId};
use crate::world::World;
use crate::world::can_side::Owner;

/// A frame that was sent on a bus and acknowledged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusFrame {
    /// Start of frame, simulated ns.
    pub start_ns: u64,
    /// End of frame, simulated ns.
    pub end_ns: u64,
    /// The frame as sent on the wire.
    pub frame: CanFrame,
    /// True if the frame was sent by the gateway channel for which the recording was started; in a
    /// recording of all buses, by any gateway channel.
    pub is_from_channel: bool,
    /// Index of the gateway and channel that sent the frame; `None` for a node.
    pub channel: Option<(usize, usize)>,
}

#[derive(Clone)]
enum Scope {
    Channel { bus: usize, station: StationId },
    All,
}

#[derive(Clone)]
pub(super) struct Recording {
    scope: Scope,
    /// Frames with the index of their bus; those of one bus in order.
    frames: Vec<(usize, BusFrame)>,
}

impl Recording {
    fn new(scope: Scope) -> Self {
        Self { scope, frames: Vec::new() }
    }

    /// Orders the frames of all buses by their ends. Each bus runs alone between two common events, so that
    /// they were noted bus by bus.
    fn sort(&mut self) {
        self.frames.sort_unstable_by_key(|(bus, frame)| (frame.end_ns, *bus));
    }

    pub(super) fn note(&mut self, bus: usize, owners: &[Owner], event: &BusEvent) {
        if let BusEvent::Transmitted { station, frame, start_ns, at_ns } = *event {
            let broadcast = Broadcast { sender: station, frame, start_ns, at_ns };
            self.note_broadcast(bus, owners, &broadcast);
        }
    }

    pub(super) fn note_broadcast(&mut self, bus: usize, owners: &[Owner], sent: &Broadcast) {
        let Broadcast { sender, frame, start_ns, at_ns } = *sent;
        let channel = match owners.get(sender.index()) {
            Some(Owner::Channel { gateway, channel }) => Some((*gateway, *channel)),
            _ => None,
        };
        let is_from_channel = match self.scope {
            Scope::Channel { bus: recorded, .. } if recorded != bus => return,
            Scope::Channel { station, .. } => sender == station,
            Scope::All => channel.is_some(),
        };
        let frame = BusFrame { start_ns, end_ns: at_ns, frame, is_from_channel, channel };
        self.frames.push((bus, frame));
    }
}

impl World {
    /// Starts recording every frame on the bus of a gateway's channel; replaces a running
    /// recording. Returns false if the channel does not exist. A recording needs memory for each
    /// frame until it is taken.
    pub fn record_bus_of(&mut self, gateway: usize, channel: usize) -> bool {
        let link = self.slots.get(gateway).and_then(|slot| slot.links.get(channel));
        let scope = link.map(|link| Scope::Channel { bus: link.bus, station: link.station });
        self.recording = scope.map(Recording::new);
        self.recording.is_some()
    }

    /// Starts recording every frame on every bus; replaces a running recording. A recording needs
    /// memory for each frame until it is taken.
    pub fn record_all_buses(&mut self) {
        self.recording = Some(Recording::new(Scope::All));
    }

    /// Takes the frames recorded since the last call, in the order of the bus. Empty if nothing is
    /// recorded.
    pub fn take_recorded(&mut self) -> Vec<BusFrame> {
        let frames = self.recording.as_mut().map(|it| {
            it.sort();
            std::mem::take(&mut it.frames)
        });
        frames.unwrap_or_default().into_iter().map(|(_, frame)| frame).collect()
    }

    /// As [`take_recorded`](Self::take_recorded), with the bus name of each frame, in the order in
    /// which the frames ended; keeps the memory allocated.
    pub fn drain_recorded(&mut self, mut take: impl FnMut(&str, &BusFrame)) {
        let Some(recording) = &mut self.recording else { return };
        recording.sort();
        for (bus, frame) in recording.frames.drain(..) {
            if let Some(slot) = self.buses.get(bus) {
                take(slot.bus.name(), &frame);
            }
        }
    }
}
