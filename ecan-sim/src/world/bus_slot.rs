//! A bus in the world: the owners of its stations, the frames that each of them reads, the times at which its nodes
//! are due, the link of a gateway to it, and the recording of its frames.

use ecan_protocol::can::{CanFrame, CanId};

use crate::bus::{Broadcast, BusEvent, CanBus, ErrorState, StationId, StationSet};
use crate::drive::StandardIds;
use crate::event_queue::NEVER;
use crate::gateway::Gateway;

/// Owner of a station.
#[derive(Clone, Copy)]
pub(super) enum Owner {
    Channel { gateway: usize, channel: usize },
    Node(usize),
}

#[derive(Clone)]
pub(super) struct BusSlot {
    pub(super) bus: CanBus,
    /// By station.
    pub(super) owners: Vec<Owner>,
    /// Time of the next event of the bus.
    pub(super) next: u64,
    /// Time of the next event of each node, by station.
    pub(super) nodes_due: DeadlineSet,
    /// The gateways with a channel on the bus.
    pub(super) gateways: Vec<usize>,
    pub(super) listeners: Listeners,
    /// A node may connect it with other buses.
    pub(super) has_external_node: bool,
}

impl BusSlot {
    pub(super) fn new(bus: CanBus) -> Self {
        Self {
            bus,
            owners: Vec::new(),
            next: NEVER,
            nodes_due: DeadlineSet::default(),
            gateways: Vec::new(),
            listeners: Listeners::default(),
            has_external_node: false,
        }
    }

    /// Returns whether the bus has no influence on other buses, except through its gateways.
    pub(super) fn is_independent(&self) -> bool {
        !self.has_external_node && self.bus.is_undisturbed()
    }

    pub(super) fn attach(&mut self, owner: Owner) -> StationId {
        self.listeners.add(self.owners.len());
        self.owners.push(owner);
        self.nodes_due.add();
        if let Owner::Channel { gateway, .. } = owner {
            self.gateways.push(gateway);
        }
        self.bus.attach()
    }

    /// Time of the next event of the bus or of one of its nodes.
    pub(super) fn next_event(&self) -> u64 {
        self.next.min(self.nodes_due.first())
    }

    pub(super) fn refresh(&mut self) {
        self.next = self.bus.next_event().unwrap_or(NEVER);
    }

    pub(super) fn replan(&mut self) {
        self.bus.replan();
        self.refresh();
    }

    /// Puts the next frame of a gateway's channel into arbitration. Returns whether the bus must be planned
    /// again.
    pub(super) fn offer_next(
        &mut self,
        now: u64,
        gateway: &mut Gateway,
        channel: usize,
        station: StationId,
    ) -> bool {
        if self.bus.config(station).is_some()
            && !self.bus.is_offering(station)
            && let Some(frame) = gateway.next_transmit(channel)
        {
            return self.bus.offer_unplanned(now, station, &frame);
        }
        false
    }
}

/// A gateway's channel as a station on its bus.
#[derive(Clone)]
pub(super) struct ChannelLink {
    pub(super) bus: usize,
    pub(super) station: StationId,
    /// Configuration generation that the bus has applied.
    pub(super) generation: Option<u32>,
    /// Error state and counters last passed to the gateway.
    reported: (ErrorState, u16, u16),
    /// All errors of the station, and those that raised a counter.
    errors_reported: (u64, u64),
}

impl ChannelLink {
    pub(super) fn new((bus, station): (usize, StationId)) -> Self {
        let reported = (ErrorState::Active, 0, 0);
        Self { bus, station, generation: None, reported, errors_reported: (0, 0) }
    }

    /// Passes a change of error state, error counters or errors on the bus to the gateway.
    pub(super) fn report(&mut self, now: u64, bus: &CanBus, gateway: &mut Gateway, channel: usize) {
        let (tec, rec) = bus.error_counters(self.station);
        let state = (bus.error_state(self.station), tec, rec);
        if self.reported != state {
            self.reported = state;
            gateway.bus_state(now, channel, state.0, tec, rec);
        }
        let errors = bus.error_counts(self.station);
        if self.errors_reported != errors
            && let Some(last) = bus.last_error(self.station)
        {
            let counted = errors.1 - self.errors_reported.1;
            self.errors_reported = errors;
            gateway.bus_errors(now, channel, counted, last);
        }
    }
}

/// Times by index, with the cached minimum, which is read at every instant.
#[derive(Clone, Debug)]
pub(super) struct DeadlineSet {
    times: Vec<u64>,
    first: u64,
    /// Number of times that are equal to `first`. Drives are due together: the minimum is searched
    /// once for all of them.
    at_first: usize,
}

impl Default for DeadlineSet {
    fn default() -> Self {
        Self { times: Vec::new(), first: NEVER, at_first: 0 }
    }
}

impl DeadlineSet {
    pub(super) fn add(&mut self) {
        self.times.push(NEVER);
        self.at_first += usize::from(self.first == NEVER);
    }

    pub(super) fn get(&self, number: usize) -> u64 {
        self.times.get(number).copied().unwrap_or(NEVER)
    }

    pub(super) const fn first(&self) -> u64 {
        self.first
    }

    pub(super) fn set(&mut self, number: usize, time: u64) {
        let Some(slot) = self.times.get_mut(number) else { return };
        let before = std::mem::replace(slot, time);
        if time < self.first {
            (self.first, self.at_first) = (time, 1);
            return;
        }
        self.at_first += usize::from(time == self.first);
        self.at_first -= usize::from(before == self.first);
        if self.at_first == 0 {
            self.first = self.times.iter().copied().min().unwrap_or(NEVER);
            self.at_first = self.times.iter().filter(|time| **time == self.first).count();
        }
    }
}

/// The stations that may read a frame, by its CAN ID. A station reads all frames until
/// [`filter`](Self::filter) is called for it.
#[derive(Clone, Debug, Default)]
pub(super) struct Listeners {
    all: StationSet,
    /// By standard CAN ID.
    standard: Vec<StationSet>,
    /// What each station reads.
    filters: Vec<StandardIds>,
}

impl Listeners {
    pub(super) fn add(&mut self, station: usize) {
        let ids = StandardIds::all();
        self.standard.resize_with(ids.iter().count(), StationSet::default);
        self.all.insert(station);
        self.standard.iter_mut().for_each(|stations| stations.insert(station));
        self.filters.push(ids);
    }

    /// Sets the standard CAN IDs that a station reads. Frames with extended ones reach all stations.
    pub(super) fn filter(&mut self, station: usize, ids: &StandardIds) {
        let Some(filter) = self.filters.get_mut(station) else { return };
        let before = std::mem::replace(filter, *ids);
        for raw in before.differences(ids) {
            let Some(stations) = self.standard.get_mut(raw) else { continue };
            if ids.contains(raw) {
                stations.insert(station);
            } else {
                stations.remove(station);
            }
        }
    }

    pub(super) fn of(&self, id: CanId) -> &StationSet {
        match self.standard.get(id.raw() as usize) {
            Some(stations) if !id.is_extended() => stations,
            _ => &self.all,
        }
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_is_updated_by_every_change() {
        let mut due = DeadlineSet::default();
        assert_eq!(due.first(), NEVER);
        (0..3).for_each(|_| due.add());
        let mut set = |number, time| {
            due.set(number, time);
            due.first()
        };
        assert_eq!([set(0, 30), set(1, 20), set(2, 40)], [30, 20, 20]);
        assert_eq!([set(1, 50), set(0, NEVER), set(2, 40)], [30, 40, 40]);
        assert_eq!([set(1, 40), set(2, 60), set(1, NEVER)], [40, 40, 60]);
        assert_eq!(set(9, 1), 60, "unknown index");
        assert_eq!((due.get(2), due.get(9)), (60, NEVER));
    }

    #[test]
    fn filtered_station_gets_its_standard_and_all_extended_ids() {
        let mut listeners = Listeners::default();
        (0..3).for_each(|station| listeners.add(station));
        let mut ids = StandardIds::default();
        ids.insert(0x80);
        listeners.filter(1, &ids);
        let of = |id| listeners.of(id).iter().collect::<Vec<_>>();
        assert_eq!(of(CanId::standard(0x80).unwrap()), [0, 1, 2]);
        assert_eq!(of(CanId::standard(0x7FF).unwrap()), [0, 2]);
        assert_eq!(of(CanId::extended(0x81).unwrap()), [0, 1, 2]);
    }
}
