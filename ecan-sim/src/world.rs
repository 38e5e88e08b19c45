//! The simulated world: gateways on an EtherCAT line, their CAN buses with nodes, and faults. The
//! front ends `ecrt` and `esc` drive it through `line`.

mod attached_node;
mod can_side;
mod copy;
mod deadline_set;
mod drives;
mod faults;
mod fmmu;
mod io_slot;
mod line;
mod listeners;
mod node_slot;
mod recording;
mod slave_description;

use ecan_protocol::mapping::CHANNELS;

use crate::backend_error::BackendError;
use crate::bus::{BusEvent, BusStatistics, CanBus, StationId, StationStatistics};
use crate::fault::{FaultLog, FaultScript, LibraryCall, LossDirection};
use crate::gateway::{Gateway, GatewayCounters};
use crate::node::BridgeFactory;
use crate::scenario::{GatewaySpec, Scenario, Topology};
use crate::sii;
use crate::world::can_side::BusSlot;
use crate::world::io_slot::IoSlot;
use crate::world::line::{ChannelLink, LineSlot};
use crate::world::node_slot::NodeSlot;
use crate::world::recording::Recording;

pub use recording::BusFrame;

pub(crate) use fmmu::{Fmmu, LogicalCommand, ProcessDirection};
pub(crate) use line::{CycleFaults, Slot};
pub(crate) use slave_description::SlaveDescription;

/// Simulated time at which every stepped world begins, ns. Not 0, which some interfaces take for
/// "no time given".
pub(crate) const EPOCH_NS: u64 = 1_000_000_000;

const NEVER: u64 = u64::MAX;

/// The world of a simulation.
///
/// Time advances only in [`advance`](Self::advance). Everything that happens at one instant happens
/// in a fixed order: faults, supplies, gateways, nodes, buses, each in the order of the scenario; between such instants of
/// gateways and faults each bus without nodes of the application runs alone.
pub struct World {
    now: u64,
    start: u64,
    seed: u64,
    topology: Topology,
    /// The slaves in the order of the line.
    line: Vec<Slot>,
    slots: Vec<LineSlot>,
    ios: Vec<IoSlot>,
    buses: Vec<BusSlot>,
    nodes: Vec<NodeSlot>,
    /// True if the nodes due at this instant have run.
    nodes_had_turn: bool,
    script: FaultScript,
    fault_log: FaultLog,
    lost: (Option<LossDirection>, u32),
    counter_offset: (i32, u32),
    /// Error number and remaining count, by call of the library.
    library_errors: [(i32, u32); LibraryCall::ALL.len()],
    /// Time until which the master starts no request.
    requests_held_until: u64,
    cycle: u64,
    events: Vec<BusEvent>,
    recording: Option<Recording>,
}

impl World {
    /// Builds the world of a scenario at `now` nanoseconds, with the gateways switched on.
    ///
    /// # Errors
    /// A recording or an EDS cannot be read, or a bridge cannot be made.
    pub(crate) fn new(
        scenario: &Scenario,
        now: u64,
        bridges: Option<BridgeFactory>,
    ) -> Result<Self, BackendError> {
        let mut world = Self {
            now,
            seed: scenario.seed,
            start: now,
            topology: scenario.topology,
            line: line::order(scenario),
            slots: Vec::with_capacity(scenario.gateways.len()),
            ios: scenario.ios.iter().map(|spec| IoSlot::new(spec.clone(), now)).collect(),
            buses: Vec::new(),
            nodes: Vec::with_capacity(scenario.nodes.len()),
            nodes_had_turn: true,
            script: FaultScript::default(),
            fault_log: FaultLog::default(),
            lost: (None, 0),
            counter_offset: (0, 0),
            library_errors: [(0, 0); LibraryCall::ALL.len()],
            requests_held_until: 0,
            cycle: 0,
            events: Vec::with_capacity(64),
            recording: None,
        };
        for (position, spec) in scenario.gateways.iter().enumerate() {
            let links = std::array::from_fn::<_, CHANNELS, _>(|channel| {
                let owner = can_side::Owner::Channel { gateway: position, channel };
                let (bus, station) = world.attach(&spec.buses[channel], owner);
                ChannelLink::new(bus, station)
            });
            let seed = scenario.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ position as u64;
            let mut gateway = Gateway::new(spec.config.clone(), seed);
            gateway.power(now, true);
            gateway.install_eeprom(sii::image(&GatewaySpec {
                sii_sync_managers: GatewaySpec::SII_SYNC_MANAGERS,
                ..spec.clone()
            }));
            for (word, value) in (0..).zip(sii::image(spec)) {
                gateway.write_eeprom(word, value);
            }
            world.slots.push(LineSlot::new(gateway, spec.clone(), links));
        }
        for (index, spec) in scenario.nodes.iter().enumerate() {
            let (bus, station) = world.attach(&spec.bus, can_side::Owner::Node(index));
            let seed = scenario.seed.rotate_left(17) ^ 0xD1B5_4A32_D192_ED03 ^ index as u64;
            world.add_node(NodeSlot::new(spec, bus, station, seed, bridges)?);
            if let Some(slot) = world.buses.get_mut(bus) {
                slot.bus.set_physical_layer(station, spec.physical_layer);
            }
        }
        for index in 0..world.nodes.len() {
            if let Some(config) = world.nodes.get(index).and_then(|node| node.fixed) {
                world.configure_node(index, config);
            }
        }
        for slot in 0..world.slots.len() {
            world.update_gateway(slot);
        }
        Ok(world)
    }

    /// Adds a station to a bus; creates the bus if necessary.
    fn attach(&mut self, name: &str, owner: can_side::Owner) -> (usize, StationId) {
        let bus = self.buses.iter().position(|slot| slot.bus.name() == name).unwrap_or_else(|| {
            let seed = self.seed.rotate_left(29) ^ self.buses.len() as u64;
            self.buses.push(BusSlot::new(CanBus::new(name).with_seed(seed)));
            self.buses.len() - 1
        });
        // infallible: the index was found or made above
        let slot = &mut self.buses[bus];
        (bus, slot.attach(owner))
    }

    /// Simulated time, ns.
    pub fn now_ns(&self) -> u64 {
        self.now
    }

    /// Start of the simulation, ns: reference of scripted times.
    pub fn start_ns(&self) -> u64 {
        self.start
    }

    /// Number of sends with process data.
    pub fn cycles(&self) -> u64 {
        self.cycle
    }

    pub(crate) fn topology(&self) -> Topology {
        self.topology
    }

    /// Number of gateways, powered or not.
    pub fn gateway_count(&self) -> usize {
        self.slots.len()
    }

    /// A gateway by its index in the scenario.
    pub fn gateway(&self, index: usize) -> Option<&Gateway> {
        self.slots.get(index).map(|slot| &slot.gateway)
    }

    /// Changes a gateway and then updates what depends on it.
    pub fn with_gateway<R>(
        &mut self,
        index: usize,
        change: impl FnOnce(&mut Gateway, u64) -> R,
    ) -> Option<R> {
        let now = self.now;
        let slot = self.slots.get_mut(index)?;
        let result = change(&mut slot.gateway, now);
        self.update_gateway(index);
        Some(result)
    }

    /// Counters of a gateway's actual events.
    pub fn counters(&self, gateway: usize) -> Option<GatewayCounters> {
        self.slots.get(gateway).map(|slot| *slot.gateway.counters())
    }

    /// Names of the buses.
    pub fn bus_names(&self) -> impl Iterator<Item = &str> {
        self.buses.iter().map(|slot| slot.bus.name())
    }

    /// A bus by its name.
    pub fn bus(&self, name: &str) -> Option<&CanBus> {
        self.buses.iter().find(|slot| slot.bus.name() == name).map(|slot| &slot.bus)
    }

    /// The bus of a gateway's channel.
    pub fn bus_of(&self, gateway: usize, channel: usize) -> Option<&CanBus> {
        let link = self.slots.get(gateway)?.links.get(channel)?;
        self.buses.get(link.bus).map(|slot| &slot.bus)
    }

    /// Counters of the bus of a gateway's channel.
    pub fn bus_statistics(&self, gateway: usize, channel: usize) -> Option<BusStatistics> {
        self.bus_of(gateway, channel).map(CanBus::statistics)
    }

    /// Counters of a gateway's channel as a station on its bus.
    pub fn channel_statistics(&self, gateway: usize, channel: usize) -> Option<StationStatistics> {
        let link = self.slots.get(gateway)?.links.get(channel)?;
        self.buses.get(link.bus).map(|slot| slot.bus.station_statistics(link.station))
    }

    /// Time of the next event.
    pub(crate) fn next_event(&self) -> u64 {
        // Plain loops: this runs at every instant.
        let mut next = self.script.next_time().unwrap_or(NEVER);
        for slot in &self.buses {
            next = next.min(slot.next_event());
        }
        for slot in &self.slots {
            next = next.min(slot.next).min(slot.power_on_at.unwrap_or(NEVER));
        }
        next
    }

    /// Time of the next event that can concern several buses.
    fn next_common_event(&self) -> u64 {
        let mut next = self.script.next_time().unwrap_or(NEVER);
        for slot in &self.slots {
            let due = if slot.is_idle_at(self.now) { slot.due } else { 0 };
            next = next.min(due).min(slot.power_on_at.unwrap_or(NEVER));
        }
        next
    }

    /// Advances time to `to`, ns. An earlier time has no effect.
    pub fn advance(&mut self, to: u64) {
        while self.now <= to {
            self.run_buses_before(self.next_common_event().min(to));
            let next = self.next_event().max(self.now);
            if next > to {
                break;
            }
            self.now = next;
            self.run_instant();
        }
        self.now = self.now.max(to);
        let now = self.now;
        for slot in self.nodes.iter_mut().filter(|slot| !slot.is_postponed) {
            slot.node.catch_up(now);
        }
    }

    /// Executes everything that is due now. What results from it at the same instant is executed by
    /// the next call.
    fn run_instant(&mut self) {
        let now = self.now;
        self.nodes_had_turn = false;
        while let Some(fault) = self.script.due_time(now) {
            self.inject(fault);
        }
        for index in 0..self.slots.len() {
            self.run_slot(index);
        }
        self.nodes_had_turn = true;
        for index in 0..self.buses.len() {
            self.run_bus_with_nodes(index);
        }
    }

    /// Executes what happens on each bus before `end`, where no gateway acts and no fault is due: until then
    /// the buses have no influence on each other. A bus with errors is left to
    /// [`run_instant`](Self::run_instant), since its gateways report them in the order of time, and one with
    /// a node of the application.
    fn run_buses_before(&mut self, end: u64) {
        let begin = self.now;
        for index in 0..self.buses.len() {
            while let Some(slot) = self.buses.get(index)
                && slot.is_independent()
                && slot.next_event() < end
            {
                self.now = slot.next_event().max(begin);
                self.run_bus_with_nodes(index);
            }
        }
        self.now = begin;
    }

    fn run_bus_with_nodes(&mut self, index: usize) {
        let now = self.now;
        let Some(slot) = self.buses.get(index) else { return };
        if slot.nodes_due.first() <= now {
            for station in 0..slot.owners.len() {
                self.run_node(index, station);
            }
        }
        self.run_bus(index);
    }

    fn run_slot(&mut self, index: usize) {
        let now = self.now;
        let Some(slot) = self.slots.get_mut(index) else { return };
        if slot.power_on_at.is_some_and(|at| at <= now) {
            slot.power_on_at = None;
            slot.gateway.power(now, true);
            slot.next = now;
        }
        if slot.next <= now {
            slot.gateway.advance(now);
            self.update_gateway(index);
        }
    }
}

fn ms(ms: u32) -> u64 {
    u64::from(ms) * 1_000_000
}
