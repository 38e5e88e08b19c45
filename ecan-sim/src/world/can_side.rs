//! CAN side of the world: the buses, their nodes, and the frames between gateways, nodes and buses.

use ecan_canopen::NodeId;
use ecan_protocol::mapping::CHANNELS;

use super::bus_slot::{BusFrame, Recording, Scope};
use crate::backend_error::BackendError;
use crate::bus::{
    BusEvent, BusFault, CanBus, ErrorState, StationConfig, StationId, StationMode,
    StationStatistics,
};
use crate::drive::Drive;
use crate::event_queue::NEVER;
use crate::fault::DriveFault;
use crate::gateway::Gateway;
use crate::node::{BridgeFactory, Node};
use crate::scenario::Scenario;
use crate::world::bus_slot::{BusSlot, ChannelLink, Owner};
use crate::world::line::Line;
use crate::world::node_slot::{NodeBody, NodeSlot};

/// The CAN buses of a world with their nodes. Gateways are on the [`Line`], which the calls take.
pub(super) struct CanSide {
    seed: u64,
    buses: Vec<BusSlot>,
    nodes: Vec<NodeSlot>,
    /// The channels of each gateway.
    links: Vec<[ChannelLink; CHANNELS]>,
    /// True if the nodes due at this instant have run.
    nodes_had_turn: bool,
    events: Vec<BusEvent>,
    recording: Option<Recording>,
}

impl CanSide {
    /// The buses and nodes of a scenario.
    ///
    /// # Errors
    /// A recording or an EDS cannot be read, or a bridge cannot be made.
    pub(super) fn new(
        scenario: &Scenario,
        now: u64,
        bridges: Option<BridgeFactory>,
    ) -> Result<Self, BackendError> {
        let mut can = Self {
            seed: scenario.seed,
            buses: Vec::new(),
            nodes: Vec::with_capacity(scenario.nodes.len()),
            links: Vec::with_capacity(scenario.gateways.len()),
            nodes_had_turn: true,
            events: Vec::with_capacity(64),
            recording: None,
        };
        for (gateway, spec) in scenario.gateways.iter().enumerate() {
            let links = std::array::from_fn(|channel| {
                let owner = Owner::Channel { gateway, channel };
                ChannelLink::new(can.attach(&spec.buses[channel], owner))
            });
            can.links.push(links);
        }
        for (index, spec) in scenario.nodes.iter().enumerate() {
            let (bus, station) = can.attach(&spec.bus, Owner::Node(index));
            let seed = scenario.seed.rotate_left(17) ^ 0xD1B5_4A32_D192_ED03 ^ index as u64;
            can.add_node(NodeSlot::new(spec, bus, station, seed, bridges)?);
            if let Some(slot) = can.buses.get_mut(bus) {
                slot.bus.set_physical_layer(station, spec.physical_layer);
            }
        }
        for index in 0..can.nodes.len() {
            if let Some(config) = can.nodes.get(index).and_then(|node| node.fixed) {
                can.configure_node(now, index, config);
            }
        }
        Ok(can)
    }

    /// A copy in the present state; `None` if a node cannot be copied.
    pub(super) fn try_clone(&self) -> Option<Self> {
        Some(Self {
            seed: self.seed,
            buses: self.buses.clone(),
            nodes: self.nodes.iter().map(NodeSlot::try_clone).collect::<Option<_>>()?,
            links: self.links.clone(),
            nodes_had_turn: self.nodes_had_turn,
            events: self.events.clone(),
            recording: self.recording.clone(),
        })
    }

    /// Adds a station to a bus; creates the bus if necessary.
    fn attach(&mut self, name: &str, owner: Owner) -> (usize, StationId) {
        let bus = self.buses.iter().position(|slot| slot.bus.name() == name).unwrap_or_else(|| {
            let seed = self.seed.rotate_left(29) ^ self.buses.len() as u64;
            self.buses.push(BusSlot::new(CanBus::new(name).with_seed(seed)));
            self.buses.len() - 1
        });
        // infallible: the index was found or made above
        let slot = &mut self.buses[bus];
        (bus, slot.attach(owner))
    }

    pub(super) fn buses(&self) -> impl Iterator<Item = &CanBus> {
        self.buses.iter().map(|slot| &slot.bus)
    }

    fn link(&self, gateway: usize, channel: usize) -> Option<&ChannelLink> {
        self.links.get(gateway)?.get(channel)
    }

    /// The bus of a gateway's channel.
    pub(super) fn bus_of(&self, gateway: usize, channel: usize) -> Option<&CanBus> {
        self.buses.get(self.link(gateway, channel)?.bus).map(|slot| &slot.bus)
    }

    /// Counters of a gateway's channel as a station on its bus.
    pub(super) fn channel_statistics(
        &self,
        gateway: usize,
        channel: usize,
    ) -> Option<StationStatistics> {
        let link = self.link(gateway, channel)?;
        self.buses.get(link.bus).map(|slot| slot.bus.station_statistics(link.station))
    }

    /// The nodes, each with the name of its bus.
    pub(super) fn nodes(&self) -> impl Iterator<Item = (&str, &dyn Node)> {
        self.nodes.iter().filter(|slot| !slot.detached).filter_map(|slot| {
            let bus = self.buses.get(slot.bus)?;
            Some((bus.bus.name(), slot.node.as_node()))
        })
    }

    /// The drives with their names, in the order of the scenario.
    pub(super) fn drives(&self) -> impl Iterator<Item = (&str, &Drive)> {
        self.nodes.iter().filter_map(NodeSlot::drive)
    }

    /// The drive with this node-ID on a gateway's channel, with its name.
    pub(super) fn drive_at(
        &self,
        gateway: usize,
        channel: usize,
        node: NodeId,
    ) -> Option<(&str, &Drive)> {
        let bus = self.link(gateway, channel)?.bus;
        let mut drives =
            self.nodes.iter().filter(|slot| slot.bus == bus).filter_map(NodeSlot::drive);
        drives.find(|(_, drive)| drive.node_id() == node)
    }

    /// Time of the next event of a bus or a node.
    pub(super) fn next_event(&self) -> u64 {
        let mut next = NEVER;
        for slot in &self.buses {
            next = next.min(slot.next_event());
        }
        next
    }

    /// Begins an instant: what nodes have to do now comes after the faults and the gateways.
    pub(super) fn begin_instant(&mut self) {
        self.nodes_had_turn = false;
    }

    /// Ends an instant: runs the buses with their nodes.
    pub(super) fn end_instant(&mut self, now: u64, line: &mut Line) {
        self.nodes_had_turn = true;
        for index in 0..self.buses.len() {
            self.run_bus_with_nodes(now, line, index);
        }
    }

    /// Executes what happens on each bus from `begin` to `end`, where no gateway acts and no fault is due: until
    /// then the buses have no influence on each other. A bus with errors is left to
    /// [`end_instant`](Self::end_instant), since its gateways report them in the order of time, and one with
    /// a node of the application.
    pub(super) fn run_buses_before(&mut self, begin: u64, end: u64, line: &mut Line) {
        for index in 0..self.buses.len() {
            while let Some(slot) = self.buses.get(index)
                && slot.is_independent()
                && slot.next_event() < end
            {
                let now = slot.next_event().max(begin);
                self.run_bus_with_nodes(now, line, index);
            }
        }
    }

    fn run_bus_with_nodes(&mut self, now: u64, line: &mut Line, index: usize) {
        let Some(slot) = self.buses.get(index) else { return };
        if slot.nodes_due.first() <= now {
            for station in 0..slot.owners.len() {
                self.run_node(now, index, station);
            }
        }
        self.run_bus(now, line, index);
    }

    /// Lets the nodes do what they have postponed.
    pub(super) fn catch_up(&mut self, now: u64) {
        for slot in self.nodes.iter_mut().filter(|slot| !slot.is_postponed) {
            slot.node.catch_up(now);
        }
    }

    /// Applies changes in a gateway: channel configuration, frames to send, next event.
    pub(super) fn update_gateway(&mut self, now: u64, line: &mut Line, index: usize) {
        if let Some(gateway) = line.gateway_mut(index) {
            for channel in 0..CHANNELS {
                self.update_channel(now, gateway, index, channel);
            }
        }
        line.mark_updated(index, now);
    }

    /// Applies what an event on a channel's bus changed in its gateway: only that channel, unless
    /// the gateway had something due at this instant.
    fn update_gateway_after_event(
        &mut self,
        now: u64,
        line: &mut Line,
        index: usize,
        channel: usize,
    ) {
        if line.is_unchanged(index)
            && let Some(gateway) = line.gateway_mut(index)
        {
            self.update_channel(now, gateway, index, channel);
        } else {
            self.update_gateway(now, line, index);
        }
    }

    fn update_channel(&mut self, now: u64, gateway: &mut Gateway, index: usize, channel: usize) {
        let generation = gateway.station_generation(channel);
        let Some(link) = self.links.get_mut(index).and_then(|links| links.get_mut(channel)) else {
            return;
        };
        let (bus, station) = (link.bus, link.station);
        if link.generation != Some(generation) {
            link.generation = Some(generation);
            let config = gateway.station_config(channel);
            if let Some(slot) = self.buses.get_mut(bus) {
                slot.bus.configure(now, station, config);
                slot.bus.set_physical_layer(station, gateway.physical_layer(channel));
            }
            if let Some(config) = config {
                self.configure_followers(now, bus, config);
            }
            self.report_bus_state(now, gateway, index, channel);
            if let Some(slot) = self.buses.get_mut(bus) {
                slot.refresh();
            }
            // Reporting may have changed the configuration: start over with this one in place.
            return self.update_channel(now, gateway, index, channel);
        }
        let Some(slot) = self.buses.get_mut(bus) else { return };
        let mut changed = false;
        if gateway.take_recovery_request(channel) {
            slot.bus.recover(now, station);
            changed = true;
        }
        changed |= slot.offer_next(now, gateway, channel, station);
        if changed {
            slot.replan();
        }
    }

    /// Applies the bit rates of a gateway's channel to the nodes that use them. A node starts with
    /// its first configuration.
    fn configure_followers(&mut self, now: u64, bus: usize, config: StationConfig) {
        let config = StationConfig { mode: StationMode::Normal, auto_retransmit: true, ..config };
        let follows = |node: &NodeSlot| node.bus == bus && node.fixed.is_none() && !node.detached;
        for index in 0..self.nodes.len() {
            if self.nodes.get(index).is_some_and(follows) {
                self.configure_node(now, index, config);
            }
        }
    }

    fn add_node(&mut self, node: NodeSlot) {
        if let Some(bus) = self.buses.get_mut(node.bus) {
            bus.has_external_node |= node.is_external;
        }
        self.nodes.push(node);
    }

    fn configure_node(&mut self, now: u64, index: usize, config: StationConfig) {
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
        self.collect_output(now, index);
    }

    /// Runs the node at a station, if it is due.
    fn run_node(&mut self, now: u64, bus: usize, station: usize) {
        let Some(bus) = self.buses.get(bus).filter(|bus| bus.nodes_due.get(station) <= now) else {
            return;
        };
        let Some(&Owner::Node(index)) = bus.owners.get(station) else { return };
        if let Some(slot) = self.nodes.get_mut(index) {
            slot.node.as_node_mut().advance(now, &mut slot.output);
            self.collect_output(now, index);
        }
    }

    /// Takes the frames of a node, puts the first into arbitration, and connects or disconnects its
    /// controller.
    fn collect_output(&mut self, now: u64, index: usize) {
        let changed = self.collect_unplanned(now, index);
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
    fn collect_unplanned(&mut self, now: u64, index: usize) -> bool {
        let Some(slot) = self.nodes.get_mut(index) else { return false };
        let Some(bus) = self.buses.get_mut(slot.bus) else { return false };
        slot.collect(now, self.nodes_had_turn, bus)
    }

    /// Runs a bus up to now and delivers its events.
    fn run_bus(&mut self, now: u64, line: &mut Line, index: usize) {
        loop {
            let Some(slot) = self.buses.get_mut(index) else { return };
            if slot.next > now {
                return;
            }
            if self.run_broadcast(now, line, index) {
                continue;
            }
            let Some(slot) = self.buses.get_mut(index) else { return };
            let mut events = std::mem::take(&mut self.events);
            slot.bus.advance_unplanned(now, &mut events);
            for event in &events {
                self.deliver(now, line, index, event);
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
                self.after_events(now, line, index);
            }
        }
    }

    /// Ends a frame that all stations of a bus receive, and lets those that react offer their next one.
    /// Returns false without effect if something else happens, too.
    fn run_broadcast(&mut self, now: u64, line: &mut Line, index: usize) -> bool {
        let Self { buses, nodes, recording, nodes_had_turn, .. } = self;
        let Some(bus) = buses.get_mut(index) else { return false };
        if !bus.gateways.iter().all(|gateway| line.is_idle_at(*gateway, now)) {
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
                if let Some(gateway) = line.gateway_mut(gateway) {
                    gateway.can_side(now).confirm(channel);
                    bus.offer_next(now, gateway, channel, broadcast.sender);
                }
            }
            Some(&Owner::Node(node)) => {
                if let Some(slot) = nodes.get_mut(node) {
                    slot.node.transmitted(now, frame, &mut slot.output);
                    slot.collect(now, *nodes_had_turn, bus);
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
                    if let Some(gateway) = line.gateway_mut(gateway) {
                        gateway.can_side(now).receive(now, channel, frame, broadcast.start_ns);
                    }
                }
                Some(&Owner::Node(node)) => {
                    if let Some(slot) = nodes.get_mut(node)
                        && slot.node.received(now, frame, &mut slot.output)
                    {
                        slot.collect(now, *nodes_had_turn, bus);
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
    fn deliver(&mut self, now: u64, line: &mut Line, bus: usize, event: &BusEvent) {
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
                let Some(gateway) = line.gateway_mut(gateway) else { return };
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
    fn after_events(&mut self, now: u64, line: &mut Line, bus: usize) {
        let Some(slot) = self.buses.get(bus) else { return };
        let (stations, is_undisturbed) = (slot.owners.len(), slot.bus.is_undisturbed());
        for station in 0..stations {
            let owner = self.buses.get(bus).and_then(|slot| slot.owners.get(station)).copied();
            match owner {
                Some(Owner::Channel { gateway, channel }) => {
                    if !is_undisturbed && let Some(model) = line.gateway_mut(gateway) {
                        self.report_bus_state(now, model, gateway, channel);
                    }
                    self.update_gateway_after_event(now, line, gateway, channel);
                }
                Some(Owner::Node(index))
                    if self.nodes.get(index).is_some_and(|slot| slot.has_events) =>
                {
                    self.recover_node(now, index);
                }
                Some(Owner::Node(_)) | None => {}
            }
        }
        if let Some(slot) = self.buses.get_mut(bus) {
            slot.replan();
        }
    }

    /// Nodes recover from bus-off automatically, as most do.
    fn recover_node(&mut self, now: u64, index: usize) {
        let Some(slot) = self.nodes.get(index) else { return };
        let Some(bus) = self.buses.get_mut(slot.bus) else { return };
        if bus.bus.error_state(slot.station) == ErrorState::BusOff {
            bus.bus.recover(now, slot.station);
        }
        self.collect_unplanned(now, index);
    }

    fn report_bus_state(&mut self, now: u64, gateway: &mut Gateway, index: usize, channel: usize) {
        if let Some(link) = self.links.get_mut(index).and_then(|links| links.get_mut(channel))
            && let Some(slot) = self.buses.get(link.bus)
        {
            link.report(now, &slot.bus, gateway, channel);
        }
    }

    /// Injects a fault on the bus of a channel. Returns whether the channel exists.
    pub(super) fn bus_fault(
        &mut self,
        now: u64,
        line: &mut Line,
        gateway: usize,
        channel: usize,
        fault: impl FnOnce(StationId) -> BusFault,
    ) -> bool {
        let link = self.link(gateway, channel);
        let Some((bus, station)) = link.map(|link| (link.bus, link.station)) else { return false };
        let Some(slot) = self.buses.get_mut(bus) else { return false };
        let mut events = std::mem::take(&mut self.events);
        // The bus injects at the instant it has reached.
        slot.bus.advance(now, &mut events);
        slot.bus.inject(fault(station));
        slot.refresh();
        for event in &events {
            self.deliver(now, line, bus, event);
        }
        events.clear();
        self.events = events;
        // Faults come first: who already ran at this instant runs again after them.
        for node in self.nodes.iter_mut().filter(|node| node.bus == bus) {
            node.has_events = true;
        }
        for (gateway, links) in self.links.iter().enumerate() {
            if links.iter().any(|link| link.bus == bus) {
                line.force_update(gateway);
            }
        }
        self.after_events(now, line, bus);
        true
    }

    /// Puts a node of the application on an existing or a new bus and returns its index.
    pub(super) fn attach_node(
        &mut self,
        now: u64,
        bus: &str,
        name: &str,
        node: Box<dyn Node>,
    ) -> usize {
        let index = self.nodes.len();
        let (bus, station) = self.attach(bus, Owner::Node(index));
        let slot = NodeSlot::with_node(name.to_owned(), NodeBody::Other(node), bus, station);
        self.add_node(NodeSlot { is_external: true, ..slot });
        // The gateway's channel may be running already.
        let config_of_channel = self.links.iter().flatten().find_map(|link| {
            let config = self.buses.get(link.bus)?.bus.config(link.station)?;
            (link.bus == bus).then_some(config)
        });
        if let Some(config) = config_of_channel {
            self.configure_followers(now, bus, config);
        }
        index
    }

    /// Takes a node off its bus for good and returns it.
    pub(super) fn detach_node(&mut self, now: u64, index: usize) -> Option<Box<dyn Node>> {
        let slot = self.nodes.get_mut(index)?;
        if let Some(bus) = self.buses.get_mut(slot.bus) {
            bus.nodes_due.set(slot.station.index(), NEVER);
            bus.bus.configure(now, slot.station, None);
            bus.refresh();
        }
        Some(slot.detach())
    }

    /// Injects a fault in a drive. Returns whether the drive exists.
    pub(super) fn drive_fault(&mut self, now: u64, name: &str, fault: DriveFault) -> bool {
        let Some(index) = self.nodes.iter().position(|slot| slot.name == name) else {
            return false;
        };
        if !self.nodes.get_mut(index).is_some_and(|slot| slot.inject(now, fault)) {
            return false;
        }
        self.collect_output(now, index);
        true
    }

    /// Lets a node send nothing until a time. Returns whether the node exists.
    pub(super) fn silence_node(&mut self, name: &str, until: u64) -> bool {
        let Some(slot) = self.nodes.iter_mut().find(|slot| slot.name == name) else { return false };
        slot.muted_until = until;
        slot.output.clear();
        true
    }

    /// Starts a recording of the bus of a gateway's channel. Returns false if the channel does not exist; then
    /// nothing is recorded.
    pub(super) fn record_bus_of(&mut self, gateway: usize, channel: usize) -> bool {
        let link = self.link(gateway, channel);
        let scope = link.map(|link| Scope::Channel { bus: link.bus, station: link.station });
        self.recording = scope.map(Recording::new);
        self.recording.is_some()
    }

    pub(super) fn record_all_buses(&mut self) {
        self.recording = Some(Recording::new(Scope::All));
    }

    /// Passes the recorded frames to `take` in the order in which they ended, each with the name of its bus.
    pub(super) fn drain_recorded(&mut self, mut take: impl FnMut(&str, &BusFrame)) {
        let Some(recording) = &mut self.recording else { return };
        for (bus, frame) in recording.drain() {
            if let Some(slot) = self.buses.get(bus) {
                take(slot.bus.name(), &frame);
            }
        }
    }
}
