//! Recording of the frames on buses.

use ecan_protocol::can::CanFrame;

use crate::bus::{Broadcast, BusEvent, StationId};
use crate::world::bus_slot::Owner;

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
pub(super) enum Scope {
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
    pub(super) fn new(scope: Scope) -> Self {
        Self { scope, frames: Vec::new() }
    }

    /// Orders the frames of all buses by their ends. Each bus runs alone between two common events, so that
    /// they were noted bus by bus.
    fn sort(&mut self) {
        self.frames.sort_unstable_by_key(|(bus, frame)| (frame.end_ns, *bus));
    }

    /// Takes the frames in the order in which they ended, each with the index of its bus; keeps the memory.
    pub(super) fn drain(&mut self) -> impl Iterator<Item = (usize, BusFrame)> {
        self.sort();
        self.frames.drain(..)
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
