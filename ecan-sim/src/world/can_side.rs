//! CAN side of the world: moves frames between gateways, nodes and buses.

use ecan_protocol::mapping::CHANNELS;

use crate::bus::{BusEvent, BusFault, CanBus, StationConfig, StationId, StationMode};
use crate::world::deadline_set::DeadlineSet;
use crate::world::line::LineSlot;
use crate::world::listeners::Listeners;
use crate::world::node_slot::{NodeBody, NodeSlot};
use crate::world::{NEVER, World};

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
    gateways: Vec<usize>,
    listeners: Listeners,
    /// A node may connect it with other buses.
    has_external_node: bool,
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

    fn replan(&mut self) {
        self.bus.replan();
        self.refresh();
    }
}

impl World {
    /// Applies changes in a gateway: channel configuration, frames to send, next event.
    pub(super) fn update_gateway(&mut self, index: usize) {
        let now = self.now;
        for channel in 0..CHANNELS {
            self.update_channel(index, channel);
        }
        if let Some(slot) = self.slots.get_mut(index) {
            // A gateway with something due now runs at the end of this instant, so that it cannot
            // stop time.
            slot.due = slot.gateway.next_event().unwrap_or(NEVER);
            slot.next = slot.due.max(now + 1);
            slot.acts_seen = Some(slot.gateway.acts);
        }
    }

    /// Applies what an event on a channel's bus changed in its gateway: only that channel, unless
    /// the gateway had something due at this instant.
    fn update_gateway_after_event(&mut self, index: usize, channel: usize) {
        match self.slots.get(index) {
            Some(slot) if slot.acts_seen == Some(slot.gateway.acts) => {
                self.update_channel(index, channel);
            }
            _ => self.update_gateway(index),
        }
    }

    fn update_channel(&mut self, index: usize, channel: usize) {
        let now = self.now;
        let Some(slot) = self.slots.get_mut(index) else { return };
        let Some(link) = slot.links.get_mut(channel) else { return };
        let Some(bus) = self.buses.get_mut(link.bus) else { return };
        let generation = slot.gateway.station_generation(channel);
        if link.generation != Some(generation) {
            link.generation = Some(generation);
            let config = slot.gateway.station_config(channel);
            bus.bus.configure(now, link.station, config);
            bus.bus.set_physical_layer(link.station, slot.gateway.physical_layer(channel));
            let bus = link.bus;
            if let Some(config) = config {
                self.configure_followers(bus, config);
            }
            self.report_bus_state(index, channel);
            if let Some(slot) = self.buses.get_mut(bus) {
                slot.refresh();
            }
            // The borrows have ended; start over with the configuration in place.
            return self.update_channel(index, channel);
        }
        let mut changed = false;
        if slot.gateway.take_recovery_request(channel) {
            bus.bus.recover(now, link.station);
            changed = true;
        }
        changed |= offer_next(now, slot, channel, bus);
        if changed {
            bus.replan();
        }
    }

    /// Applies the bit rates of a gateway's channel to the nodes that use them. A node starts with
    /// its first configuration.
    pub(super) fn configure_followers(&mut self, bus: usize, config: StationConfig) {
        let config = StationConfig { mode: StationMode::Normal, auto_retransmit: true, ..config };
        let follows = |node: &NodeSlot| node.bus == bus && node.fixed.is_none() && !node.detached;
        for index in 0..self.nodes.len() {
            if self.nodes.get(index).is_some_and(follows) {
                self.configure_node(index, config);
            }
        }
    }

    pub(super) fn add_node(&mut self, node: NodeSlot) {
        if let Some(bus) = self.buses.get_mut(node.bus) {
            bus.has_external_node |= node.is_external;
        }
        self.nodes.push(node);
    }

    pub(super) fn configure_node(&mut self, index: usize, config: StationConfig) {
        let now = self.now;
        let Some(slot) = self.nodes.get_mut(index) else { return };
        let before = slot.config.replace(config);
        if before == Some(config) {
            return;
        }
        slot.controller = None;
        let node = slot.node.as_node_mut();
        node.configured(now, &config);
        if before.is_none() {
            node.started(now, &mut slot.output);
        }
        self.collect_output(index);
    }

    /// Runs the node at a station, if it is due.
    pub(super) fn run_node(&mut self, bus: usize, station: usize) {
        let now = self.now;
        let Some(bus) = self.buses.get(bus).filter(|bus| bus.nodes_due.get(station) <= now) else {
            return;
        };
        let Some(&Owner::Node(index)) = bus.owners.get(station) else { return };
        if let Some(slot) = self.nodes.get_mut(index) {
            slot.node.as_node_mut().advance(now, &mut slot.output);
            self.collect_output(index);
        }
    }

    /// Takes the frames of a node, puts the first into arbitration, and connects or disconnects its
    /// controller.
    pub(super) fn collect_output(&mut self, index: usize) {
        let changed = self.collect_unplanned(index);
        let bus = self.nodes.get(index).map(|slot| slot.bus);
        if let Some(bus) = bus.and_then(|bus| self.buses.get_mut(bus)) {
            if changed {
                bus.bus.replan();
            }
            bus.refresh();
        }
    }

    /// As [`collect_output`](Self::collect_output) for one of several nodes of a bus. Returns whether the
    /// bus must be planned again.
    fn collect_unplanned(&mut self, index: usize) -> bool {
        let Some(slot) = self.nodes.get_mut(index) else { return false };
        let Some(bus) = self.buses.get_mut(slot.bus) else { return false };
        collect(self.now, self.nodes_had_turn, slot, bus)
    }

    /// Runs a bus up to now and delivers its events.
    pub(super) fn run_bus(&mut self, index: usize) {
        let now = self.now;
        loop {
            let Some(slot) = self.buses.get_mut(index) else { return };
            if slot.next > now {
                return;
            }
            if self.run_broadcast(index) {
                continue;
            }
            let Some(slot) = self.buses.get_mut(index) else { return };
            let mut events = std::mem::take(&mut self.events);
            slot.bus.advance_unplanned(now, &mut events);
            for event in &events {
                self.deliver(index, event);
            }
            let quiet = events.is_empty();
            events.clear();
            self.events = events;
            if quiet {
                let Some(slot) = self.buses.get_mut(index) else { return };
                slot.replan();
                if slot.next <= now {
                    // No event and no progress: continue with time.
                    slot.next = now + 1;
                    return;
                }
            } else {
                self.after_events(index);
            }
        }
    }

    /// Ends a frame that all stations of a bus receive, and lets those that react offer their next one.
    /// Returns false without effect if something else happens, too.
    fn run_broadcast(&mut self, index: usize) -> bool {
        let Self { now, buses, nodes, slots, recording, nodes_had_turn, .. } = self;
        let now = *now;
        let Some(bus) = buses.get_mut(index) else { return false };
        let is_idle =
            |gateway: &usize| slots.get(*gateway).is_some_and(|slot| slot.is_idle_at(now));
        if !bus.gateways.iter().all(is_idle) {
            return false;
        }
        let Some(broadcast) = bus.bus.take_broadcast(now) else { return false };
        if let Some(recording) = recording {
            recording.note_broadcast(index, &bus.owners, &broadcast);
        }
        let frame = &broadcast.frame;
        let sender = broadcast.sender.index();
        match bus.owners.get(sender) {
            Some(&Owner::Channel { gateway, channel }) => {
                if let Some(slot) = slots.get_mut(gateway) {
                    slot.gateway.confirm(now, channel);
                    offer_next(now, slot, channel, bus);
                }
            }
            Some(&Owner::Node(node)) => {
                if let Some(slot) = nodes.get_mut(node) {
                    slot.node.transmitted(now, frame, &mut slot.output);
                    collect(now, *nodes_had_turn, slot, bus);
                }
            }
            None => {}
        }
        let mut next = 0;
        while let Some(station) = bus.listeners.of(frame.id()).first_from(next) {
            next = station + 1;
            if station == sender || !bus.bus.is_attached(station) {
                continue;
            }
            match bus.owners.get(station) {
                Some(&Owner::Channel { gateway, channel }) => {
                    if let Some(slot) = slots.get_mut(gateway) {
                        slot.gateway.receive(now, channel, frame, broadcast.start_ns);
                    }
                }
                Some(&Owner::Node(node)) => {
                    if let Some(slot) = nodes.get_mut(node)
                        && slot.node.received(now, frame, &mut slot.output)
                    {
                        collect(now, *nodes_had_turn, slot, bus);
                    }
                }
                None => {}
            }
        }
        bus.replan();
        true
    }

    /// Delivers an event to the owner of a station. Its response is sent in
    /// [`after_events`](Self::after_events).
    fn deliver(&mut self, bus: usize, event: &BusEvent) {
        let now = self.now;
        if let Some(recording) = &mut self.recording {
            let owners = self.buses.get(bus).map_or(&[][..], |slot| &slot.owners);
            recording.note(bus, owners, event);
        }
        let station = match event {
            BusEvent::Transmitted { station, .. }
            | BusEvent::Received { station, .. }
            | BusEvent::Abandoned { station, .. }
            | BusEvent::StateChanged { station, .. } => *station,
            BusEvent::ErrorFrame { .. } => return,
        };
        let owners = self.buses.get(bus).map(|slot| &slot.owners);
        match owners.and_then(|owners| owners.get(station.index())) {
            Some(&Owner::Channel { gateway, channel }) => {
                let Some(slot) = self.slots.get_mut(gateway) else { return };
                let gateway = &mut slot.gateway;
                match event {
                    BusEvent::Transmitted { frame, .. } => gateway.transmitted(now, channel, frame),
                    BusEvent::Received { frame, start_ns, .. } => {
                        gateway.received(now, channel, frame, *start_ns);
                    }
                    BusEvent::Abandoned { frame, .. } => gateway.abandoned(now, channel, frame),
                    BusEvent::ErrorFrame { .. } | BusEvent::StateChanged { .. } => {}
                }
            }
            Some(&Owner::Node(index)) => {
                let Some(slot) = self.nodes.get_mut(index) else { return };
                if let BusEvent::Received { frame, .. } = event {
                    slot.has_events |= slot.node.received(now, frame, &mut slot.output);
                    return;
                }
                if let BusEvent::Transmitted { frame, .. } = event {
                    slot.node.transmitted(now, frame, &mut slot.output);
                }
                slot.has_events = true;
            }
            None => {}
        }
    }

    /// Passes error counters to gateways, and lets every station with an event offer its next
    /// frame.
    fn after_events(&mut self, bus: usize) {
        let Some(slot) = self.buses.get(bus) else { return };
        let (stations, is_undisturbed) = (slot.owners.len(), slot.bus.is_undisturbed());
        for station in 0..stations {
            let owner = self.buses.get(bus).and_then(|slot| slot.owners.get(station)).copied();
            match owner {
                Some(Owner::Channel { gateway, channel }) => {
                    if !is_undisturbed {
                        self.report_bus_state(gateway, channel);
                    }
                    self.update_gateway_after_event(gateway, channel);
                }
                Some(Owner::Node(index))
                    if self.nodes.get(index).is_some_and(|slot| slot.has_events) =>
                {
                    self.recover_node(index);
                }
                Some(Owner::Node(_)) | None => {}
            }
        }
        if let Some(slot) = self.buses.get_mut(bus) {
            slot.replan();
        }
    }

    /// Nodes recover from bus-off automatically, as most do.
    fn recover_node(&mut self, index: usize) {
        let now = self.now;
        let Some(slot) = self.nodes.get(index) else { return };
        let Some(bus) = self.buses.get_mut(slot.bus) else { return };
        if bus.bus.error_state(slot.station) == crate::bus::ErrorState::BusOff {
            bus.bus.recover(now, slot.station);
        }
        self.collect_unplanned(index);
    }

    fn report_bus_state(&mut self, index: usize, channel: usize) {
        let now = self.now;
        let Some(slot) = self.slots.get_mut(index) else { return };
        let Some(link) = slot.links.get_mut(channel) else { return };
        let Some(bus) = self.buses.get(link.bus) else { return };
        let (tec, rec) = bus.bus.error_counters(link.station);
        let state = (bus.bus.error_state(link.station), tec, rec);
        if link.reported != state {
            link.reported = state;
            slot.gateway.bus_state(now, channel, state.0, tec, rec);
        }
        let errors = bus.bus.error_counts(link.station);
        if link.errors_reported != errors
            && let Some(last) = bus.bus.last_error(link.station)
        {
            let counted = errors.1 - link.errors_reported.1;
            link.errors_reported = errors;
            slot.gateway.bus_errors(now, channel, counted, last);
        }
    }

    /// Returns whether the channel exists.
    pub(super) fn bus_fault(
        &mut self,
        gateway: usize,
        channel: usize,
        fault: impl FnOnce(StationId) -> BusFault,
    ) -> bool {
        let now = self.now;
        let link = self.slots.get(gateway).and_then(|slot| slot.links.get(channel));
        let Some((bus, station)) = link.map(|link| (link.bus, link.station)) else { return false };
        let Some(slot) = self.buses.get_mut(bus) else { return false };
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
        // Faults come first: who already ran at this instant runs again after them.
        for node in self.nodes.iter_mut().filter(|node| node.bus == bus) {
            node.has_events = true;
        }
        let has_bus = |slot: &&mut LineSlot| slot.links.iter().any(|link| link.bus == bus);
        self.slots.iter_mut().filter(has_bus).for_each(|slot| slot.acts_seen = None);
        self.after_events(bus);
        true
    }
}

/// Reads what a node has to send and when it is due, and connects or disconnects its controller. Returns
/// whether the bus must be planned again.
fn collect(now: u64, nodes_had_turn: bool, slot: &mut NodeSlot, bus: &mut BusSlot) -> bool {
    slot.has_events = false;
    let controller = slot.node.controller();
    if slot.controller != Some(controller) {
        slot.controller = Some(controller);
        let config = slot.config.filter(|_| controller.is_on_bus).map(|config| StationConfig {
            nominal_bitrate: controller.bit_rate.unwrap_or(config.nominal_bitrate),
            ..config
        });
        if bus.bus.config(slot.station) != config {
            bus.bus.configure(now, slot.station, config);
        }
    }
    if let NodeBody::Drive(drive) = &slot.node
        && slot.filter_version != drive.filter_version()
    {
        slot.filter_version = drive.filter_version();
        bus.listeners.filter(slot.station.index(), drive.standard_ids());
    }
    if now < slot.muted_until || slot.config.is_none() || !controller.is_on_bus {
        slot.output.clear();
    }
    slot.is_postponed = false;
    let due = if nodes_had_turn {
        slot.node.next_due()
    } else {
        // What is due now comes after the event that is being processed.
        slot.node.catch_up(now - 1);
        let due = slot.node.as_node().next_event();
        slot.is_postponed = due.is_some_and(|at| at <= now);
        due
    };
    bus.nodes_due.set(slot.station.index(), due.map_or(NEVER, |at| at.max(now + 1)));
    if let Some(frame) = slot.output.front()
        && !bus.bus.is_offering(slot.station)
        && bus.bus.offer_unplanned(now, slot.station, frame)
    {
        slot.output.pop();
        return true;
    }
    false
}

/// Puts the next frame of a gateway's channel into arbitration. Returns whether the bus must be planned
/// again.
fn offer_next(now: u64, slot: &mut LineSlot, channel: usize, bus: &mut BusSlot) -> bool {
    let Some(station) = slot.links.get(channel).map(|link| link.station) else { return false };
    if bus.bus.config(station).is_some()
        && !bus.bus.is_offering(station)
        && let Some(frame) = slot.gateway.next_transmit(channel)
    {
        return bus.bus.offer_unplanned(now, station, &frame);
    }
    false
}
