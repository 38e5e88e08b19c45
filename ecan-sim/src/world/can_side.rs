//! The CAN side: moves frames between gateways, nodes and buses.

use ecan_protocol::CHANNELS;

use crate::bus::{BusEvent, BusFault, CanBus, StationConfig, StationId, StationMode};
use crate::world::{NEVER, World};

/// Who a station belongs to.
#[derive(Clone, Copy)]
pub(super) enum Owner {
    Channel { gateway: usize, channel: usize },
    Node(usize),
}

/// A bus, and whose its stations are.
pub(super) struct BusSlot {
    pub(super) bus: CanBus,
    /// By station.
    pub(super) owners: Vec<Owner>,
    pub(super) next: u64,
}

impl BusSlot {
    pub(super) fn new(bus: CanBus) -> Self {
        Self { bus, owners: Vec::new(), next: NEVER }
    }

    pub(super) fn refresh(&mut self) {
        self.next = self.bus.next_event().unwrap_or(NEVER);
    }
}

impl World {
    /// Takes notice of whatever changed in a gateway: channel configuration, frames to send,
    /// its next event.
    pub(super) fn touch(&mut self, index: usize) {
        let now = self.now;
        for channel in 0..CHANNELS {
            self.touch_channel(index, channel);
        }
        if let Some(slot) = self.slots.get_mut(index) {
            // A gateway that has something due now gets its turn at this instant's end, so that
            // it cannot hold time still.
            slot.next = slot.gateway.next_event().map_or(NEVER, |at| at.max(now + 1));
        }
    }

    fn touch_channel(&mut self, index: usize, channel: usize) {
        let now = self.now;
        let Some(slot) = self.slots.get_mut(index) else { return };
        let Some(link) = slot.links.get_mut(channel) else { return };
        let Some(bus) = self.buses.get_mut(link.bus) else { return };
        let generation = slot.gateway.station_generation(channel);
        if link.generation != Some(generation) {
            link.generation = Some(generation);
            let config = slot.gateway.station_config(channel);
            bus.bus.configure(now, link.station, config);
            let bus = link.bus;
            if let Some(config) = config {
                self.lead_nodes(bus, config);
            }
            self.tell_bus_state(index, channel);
            self.refresh_bus(bus);
            // Neither borrow survived; start over with the configuration in place.
            return self.touch_channel(index, channel);
        }
        let mut changed = false;
        if slot.gateway.wants_recovery(channel) {
            bus.bus.recover(now, link.station);
            changed = true;
        }
        if bus.bus.config(link.station).is_some()
            && !bus.bus.is_offering(link.station)
            && let Some(frame) = slot.gateway.next_transmit(channel)
        {
            changed |= bus.bus.offer(now, link.station, frame);
        }
        if changed {
            bus.refresh();
        }
    }

    /// Brings the bit rates of a gateway's channel to the nodes that follow it. A node starts with
    /// its first configuration.
    pub(super) fn lead_nodes(&mut self, bus: usize, config: StationConfig) {
        let config = StationConfig { mode: StationMode::Normal, auto_retransmit: true, ..config };
        for index in 0..self.nodes.len() {
            let follows = self
                .nodes
                .get(index)
                .is_some_and(|node| node.bus == bus && node.fixed.is_none() && !node.detached);
            if follows {
                self.configure_node(index, config);
            }
        }
    }

    /// Starts a node that has bit rates of its own.
    pub(super) fn start_fixed_node(&mut self, index: usize) {
        if let Some(config) = self.nodes.get(index).and_then(|node| node.fixed) {
            self.configure_node(index, config);
        }
    }

    fn configure_node(&mut self, index: usize, config: StationConfig) {
        let now = self.now;
        let Some(slot) = self.nodes.get_mut(index) else { return };
        let before = slot.config.replace(config);
        if before == Some(config) {
            return;
        }
        let node = slot.node.as_node_mut();
        node.configured(now, &config);
        if before.is_none() {
            node.started(now, &mut slot.output);
        }
        self.collect_output(index);
    }

    pub(super) fn run_node(&mut self, index: usize) {
        let now = self.now;
        let Some(slot) = self.nodes.get_mut(index) else { return };
        if slot.next <= now {
            slot.node.as_node_mut().advance(now, &mut slot.output);
            self.collect_output(index);
        }
    }

    /// Takes what a node wants to send and puts its first frame into arbitration. Also takes its
    /// controller off the bus and puts it back.
    pub(super) fn collect_output(&mut self, index: usize) {
        let now = self.now;
        let Some(slot) = self.nodes.get_mut(index) else { return };
        let config = slot.config.filter(|_| slot.node.as_node().is_on_bus());
        if now < slot.muted_until || config.is_none() {
            slot.output.clear();
        }
        slot.next = slot.node.as_node().next_event().map_or(NEVER, |at| at.max(now + 1));
        let Some(bus) = self.buses.get_mut(slot.bus) else { return };
        if bus.bus.config(slot.station) != config {
            bus.bus.configure(now, slot.station, config);
        }
        if !bus.bus.is_offering(slot.station)
            && let Some(frame) = slot.output.front()
            && bus.bus.offer(now, slot.station, *frame)
        {
            slot.output.pop();
        }
        bus.refresh();
    }

    fn refresh_bus(&mut self, index: usize) {
        if let Some(slot) = self.buses.get_mut(index) {
            slot.refresh();
        }
    }

    /// Runs a bus up to now and hands out what happened there.
    pub(super) fn run_bus(&mut self, index: usize) {
        let now = self.now;
        loop {
            let Some(slot) = self.buses.get_mut(index) else { return };
            if slot.next > now {
                return;
            }
            let mut events = std::mem::take(&mut self.events);
            slot.bus.advance(now, &mut events);
            slot.refresh();
            let quiet = events.is_empty();
            for event in &events {
                self.deliver(index, event);
            }
            let concerned = !quiet;
            events.clear();
            self.events = events;
            if concerned {
                self.after_events(index);
            } else if self.buses.get(index).is_some_and(|slot| slot.next <= now) {
                // Nothing happened and nothing moved: let the clock go on.
                if let Some(slot) = self.buses.get_mut(index) {
                    slot.next = now + 1;
                }
                return;
            }
        }
    }

    fn deliver(&mut self, bus: usize, event: &BusEvent) {
        let now = self.now;
        if let Some(recording) = &mut self.recording {
            recording.note(bus, event);
        }
        let owner = |station: StationId| {
            self.buses.get(bus).and_then(|slot| slot.owners.get(station.index())).copied()
        };
        match event {
            BusEvent::Transmitted { station, frame, .. } => match owner(*station) {
                Some(Owner::Channel { gateway, channel }) => {
                    if let Some(slot) = self.slots.get_mut(gateway) {
                        slot.gateway.transmitted(now, channel, frame);
                    }
                }
                Some(Owner::Node(index)) => {
                    if let Some(slot) = self.nodes.get_mut(index) {
                        slot.node.as_node_mut().transmitted(now, frame, &mut slot.output);
                        self.collect_output(index);
                    }
                }
                None => {}
            },
            BusEvent::Received { station, frame, start_ns, .. } => match owner(*station) {
                Some(Owner::Channel { gateway, channel }) => {
                    if let Some(slot) = self.slots.get_mut(gateway) {
                        slot.gateway.received(now, channel, frame, *start_ns);
                    }
                }
                Some(Owner::Node(index)) => {
                    if let Some(slot) = self.nodes.get_mut(index) {
                        slot.node.as_node_mut().received(now, frame, &mut slot.output);
                        self.collect_output(index);
                    }
                }
                None => {}
            },
            BusEvent::Abandoned { station, frame, .. } => match owner(*station) {
                Some(Owner::Channel { gateway, channel }) => {
                    if let Some(slot) = self.slots.get_mut(gateway) {
                        slot.gateway.abandoned(now, channel, frame);
                    }
                }
                Some(Owner::Node(index)) => self.collect_output(index),
                None => {}
            },
            BusEvent::ErrorFrame { .. } | BusEvent::StateChanged { .. } => {}
        }
    }

    /// Tells everyone on a bus the error counters, and lets everyone offer the next frame.
    fn after_events(&mut self, bus: usize) {
        let stations = self.buses.get(bus).map_or(0, |slot| slot.owners.len());
        for station in 0..stations {
            let owner = self.buses.get(bus).and_then(|slot| slot.owners.get(station)).copied();
            match owner {
                Some(Owner::Channel { gateway, channel }) => {
                    self.tell_bus_state(gateway, channel);
                    self.touch(gateway);
                }
                Some(Owner::Node(index)) => self.recover_node(index),
                None => {}
            }
        }
        self.refresh_bus(bus);
    }

    /// A node that went bus-off comes back by itself, as most do.
    fn recover_node(&mut self, index: usize) {
        let now = self.now;
        let Some(slot) = self.nodes.get(index) else { return };
        let Some(bus) = self.buses.get_mut(slot.bus) else { return };
        if bus.bus.error_state(slot.station) == crate::bus::ErrorState::BusOff {
            bus.bus.recover(now, slot.station);
        }
        self.collect_output(index);
    }

    fn tell_bus_state(&mut self, index: usize, channel: usize) {
        let now = self.now;
        let Some(slot) = self.slots.get_mut(index) else { return };
        let Some(link) = slot.links.get_mut(channel) else { return };
        let Some(bus) = self.buses.get(link.bus) else { return };
        let (tec, rec) = bus.bus.error_counters(link.station);
        let state = (bus.bus.error_state(link.station), tec, rec);
        if link.told != state {
            link.told = state;
            slot.gateway.bus_state(now, channel, state.0, tec, rec);
        }
    }

    pub(super) fn bus_off(&mut self, gateway: usize, channel: usize) {
        self.bus_fault(gateway, channel, BusFault::BusOff);
    }

    pub(super) fn error_frames(&mut self, gateway: usize, channel: usize, count: u32) {
        self.bus_fault(gateway, channel, |station| BusFault::ErrorFrames { station, count });
    }

    fn bus_fault(
        &mut self,
        gateway: usize,
        channel: usize,
        fault: impl FnOnce(StationId) -> BusFault,
    ) {
        let now = self.now;
        let link = self.slots.get(gateway).and_then(|slot| slot.links.get(channel));
        let Some((bus, station)) = link.map(|link| (link.bus, link.station)) else { return };
        let Some(slot) = self.buses.get_mut(bus) else { return };
        let mut events = std::mem::take(&mut self.events);
        // The bus injects at the instant it has reached.
        slot.bus.advance(now, &mut events);
        slot.bus.inject(fault(station));
        slot.refresh();
        for event in &events {
            self.deliver(bus, event);
        }
        events.clear();
        self.events = events;
        self.after_events(bus);
    }
}
