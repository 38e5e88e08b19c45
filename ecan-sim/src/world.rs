//! The simulated world: gateways on an EtherCAT line, their CAN buses with nodes, and faults. The
//! front ends `ecrt` and `esc` drive it.

mod bus_slot;
mod can_side;
mod line;
mod node_slot;

use ecan_canopen::NodeId;
use ecan_protocol::device::AlState;

use crate::backend_error::BackendError;
use crate::bus::{BusFault, BusStatistics, CanBus, StationStatistics};
use crate::drive::Drive;
use crate::event_queue::{NEVER, ms};
use crate::fault::{CycleFaults, Fault, FaultRecord, FaultSchedule, ScriptedFault};
use crate::gateway::{Gateway, GatewayCounters};
use crate::io_slave::IoSlave;
use crate::node::{BridgeFactory, Node};
use crate::scenario::{GatewaySpec, Scenario};
use crate::sii;
use can_side::CanSide;
use line::LogicalDatagram;

pub use bus_slot::BusFrame;

pub(crate) use line::{Fmmu, Line, LogicalCommand, ProcessDirection, Slot};

/// Simulated time at which every stepped world begins, ns. Not 0, which some interfaces take for
/// "no time given".
pub(crate) const EPOCH_NS: u64 = 1_000_000_000;

/// The world of a simulation.
///
/// Time advances only in [`advance`](Self::advance). Everything that happens at one instant happens
/// in a fixed order: faults, supplies, gateways, nodes, buses, each in the order of the scenario; between such instants of
/// gateways and faults each bus without nodes of the application runs alone.
pub struct World {
    now: u64,
    start: u64,
    cycle: u64,
    line: Line,
    can: CanSide,
    faults: FaultSchedule,
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
            start: now,
            cycle: 0,
            line: Line::new(scenario, now),
            can: CanSide::new(scenario, now, bridges)?,
            faults: FaultSchedule::default(),
        };
        for (position, spec) in scenario.gateways.iter().enumerate() {
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
            world.line.add_gateway(gateway, spec.clone());
        }
        for index in 0..world.gateway_count() {
            world.update_gateway(index);
        }
        Ok(world)
    }

    /// A copy in the present state, without the observer of faults; `None` if a node cannot be copied.
    pub(crate) fn try_clone(&self) -> Option<Self> {
        let can = self.can.try_clone()?;
        Some(Self { line: self.line.clone(), can, faults: self.faults.unobserved(), ..*self })
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

    pub(crate) fn line(&self) -> &Line {
        &self.line
    }

    pub(crate) fn line_mut(&mut self) -> &mut Line {
        &mut self.line
    }

    /// Number of gateways, powered or not.
    pub fn gateway_count(&self) -> usize {
        self.line.gateway_count()
    }

    /// A gateway by its index in the scenario.
    pub fn gateway(&self, index: usize) -> Option<&Gateway> {
        self.line.gateway(index)
    }

    /// Changes a gateway and then updates what depends on it.
    pub fn with_gateway<R>(
        &mut self,
        index: usize,
        change: impl FnOnce(&mut Gateway, u64) -> R,
    ) -> Option<R> {
        let result = change(self.line.gateway_mut(index)?, self.now);
        self.update_gateway(index);
        Some(result)
    }

    /// Changes the gateway, if the slave is one.
    pub(crate) fn with_gateway_in<R>(
        &mut self,
        slot: Slot,
        change: impl FnOnce(&mut Gateway, u64) -> R,
    ) -> Option<R> {
        self.with_gateway(slot.gateway()?, change)
    }

    fn update_gateway(&mut self, index: usize) {
        self.can.update_gateway(self.now, &mut self.line, index);
    }

    /// Counters of a gateway's actual events.
    pub fn counters(&self, gateway: usize) -> Option<GatewayCounters> {
        self.gateway(gateway).map(|gateway| *gateway.counters())
    }

    /// Number of I/O slaves.
    pub fn io_count(&self) -> usize {
        self.line.io_count()
    }

    /// An I/O slave by its index in the scenario.
    pub fn io(&self, index: usize) -> Option<&IoSlave> {
        self.line.io(index)
    }

    /// Changes an I/O slave.
    pub fn io_mut(&mut self, index: usize) -> Option<&mut IoSlave> {
        self.line.io_mut(index)
    }

    /// Names of the buses.
    pub fn bus_names(&self) -> impl Iterator<Item = &str> {
        self.can.buses().map(CanBus::name)
    }

    /// A bus by its name.
    pub fn bus(&self, name: &str) -> Option<&CanBus> {
        self.can.buses().find(|bus| bus.name() == name)
    }

    /// The bus of a gateway's channel.
    pub fn bus_of(&self, gateway: usize, channel: usize) -> Option<&CanBus> {
        self.can.bus_of(gateway, channel)
    }

    /// Counters of the bus of a gateway's channel.
    pub fn bus_statistics(&self, gateway: usize, channel: usize) -> Option<BusStatistics> {
        self.bus_of(gateway, channel).map(CanBus::statistics)
    }

    /// Counters of a gateway's channel as a station on its bus.
    pub fn channel_statistics(&self, gateway: usize, channel: usize) -> Option<StationStatistics> {
        self.can.channel_statistics(gateway, channel)
    }

    /// The nodes, each with the name of its bus.
    pub fn nodes(&self) -> impl Iterator<Item = (&str, &dyn Node)> {
        self.can.nodes()
    }

    /// The nodes that a banner has to name, each as ", `description` on bus `name`".
    pub fn node_descriptions(&self) -> String {
        let text = |(bus, node): (&str, &dyn Node)| {
            Some(format!(", {} on bus {bus}", node.description()?))
        };
        self.nodes().filter_map(text).collect()
    }

    /// Puts a node on an existing or a new bus and returns its index.
    pub(crate) fn attach_node(&mut self, bus: &str, name: &str, node: Box<dyn Node>) -> usize {
        self.can.attach_node(self.now, bus, name, node)
    }

    /// Takes a node off its bus for good and returns it.
    pub(crate) fn detach_node(&mut self, index: usize) -> Option<Box<dyn Node>> {
        self.can.detach_node(self.now, index)
    }

    /// The drives with their names, in the order of the scenario.
    pub fn drives(&self) -> impl Iterator<Item = (&str, &Drive)> {
        self.can.drives()
    }

    /// A drive by the name of its node.
    pub fn drive(&self, name: &str) -> Option<&Drive> {
        self.drives().find(|(other, _)| *other == name).map(|(_, drive)| drive)
    }

    /// The drive with this node-ID on a gateway's channel.
    pub fn drive_at(&self, gateway: usize, channel: usize, node: NodeId) -> Option<&Drive> {
        self.can.drive_at(gateway, channel, node).map(|(_, drive)| drive)
    }

    /// Name of the drive with this node-ID on a gateway's channel, for faults.
    pub fn drive_name(&self, gateway: usize, channel: usize, node: NodeId) -> Option<&str> {
        self.can.drive_at(gateway, channel, node).map(|(name, _)| name)
    }

    /// Starts recording every frame on the bus of a gateway's channel; replaces a running
    /// recording. Returns false if the channel does not exist. A recording needs memory for each
    /// frame until it is taken.
    pub fn record_bus_of(&mut self, gateway: usize, channel: usize) -> bool {
        self.can.record_bus_of(gateway, channel)
    }

    /// Starts recording every frame on every bus; replaces a running recording. A recording needs
    /// memory for each frame until it is taken.
    pub fn record_all_buses(&mut self) {
        self.can.record_all_buses();
    }

    /// Takes the frames recorded since the last call, in the order of the bus. Empty if nothing is
    /// recorded.
    pub fn take_recorded(&mut self) -> Vec<BusFrame> {
        let mut frames = Vec::new();
        self.drain_recorded(|_, frame| frames.push(*frame));
        frames
    }

    /// As [`take_recorded`](Self::take_recorded), with the bus name of each frame, in the order in
    /// which the frames ended; keeps the memory allocated.
    pub fn drain_recorded(&mut self, take: impl FnMut(&str, &BusFrame)) {
        self.can.drain_recorded(take);
    }

    /// Returns whether the master's own link is up.
    pub(crate) fn link_is_up(&self) -> bool {
        self.line.link_is_up(self.now)
    }

    /// Returns whether the cable of a gateway towards the master is open ([`Fault::LinkLoss`]).
    pub fn is_cable_open(&self, gateway: usize) -> bool {
        self.line.is_cable_open(gateway, self.now)
    }

    /// Position on the line of a gateway.
    pub fn position_of(&self, gateway: usize) -> Option<usize> {
        self.line.position_of(gateway)
    }

    /// Index of the gateway at a position of the line, from 0; `None` for an I/O slave.
    pub fn gateway_at(&self, position: usize) -> Option<usize> {
        self.line.slot_at(position).and_then(Slot::gateway)
    }

    /// Returns whether a frame of the master reaches this gateway and returns: it has booted and
    /// its cable is connected, and in a line the same holds for all slaves before it.
    pub fn is_reachable(&self, index: usize) -> bool {
        self.reaches(Slot::Gateway(index))
    }

    /// As [`is_reachable`](Self::is_reachable), for any slave.
    pub(crate) fn reaches(&self, slot: Slot) -> bool {
        self.line.reaches(slot, self.now)
    }

    /// The slaves that respond, in the order of their positions.
    pub(crate) fn reached(&self) -> impl Iterator<Item = Slot> {
        self.line.reached(self.now)
    }

    /// The master requests an AL state of a slave.
    pub(crate) fn request_al_state(&mut self, slot: Slot, state: AlState) {
        self.with_gateway_in(slot, |gateway, now| gateway.request_al_state(now, state));
        if let Some(io) = self.line.io_in_mut(slot) {
            io.request_al_state(state);
        }
    }

    /// Passes a logical datagram through all slaves and returns its working counter.
    ///
    /// Reads and writes of a slave count separately: in an LRW a read adds 1 and a write adds 2; a
    /// rejected one adds nothing and leaves the data unchanged. Outputs count as arrived `wire_ns`
    /// from now.
    pub(crate) fn exchange(
        &mut self,
        command: LogicalCommand,
        logical: u32,
        data: &mut [u8],
        wire_ns: u64,
    ) -> u16 {
        let now = self.now;
        let arrival = now.saturating_add(wire_ns);
        let mut datagram = LogicalDatagram { command, logical, data, counter: 0 };
        for index in 0..self.gateway_count() {
            if self.is_reachable(index)
                && self.line.exchange_gateway(index, now, arrival, &mut datagram)
            {
                self.update_gateway(index);
            }
        }
        self.line.exchange_ios(now, &mut datagram);
        datagram.counter
    }

    /// Time of the next event.
    pub(crate) fn next_event(&self) -> u64 {
        let fault = self.faults.script().next_time().unwrap_or(NEVER);
        fault.min(self.can.next_event()).min(self.line.next_event())
    }

    /// Advances time to `to`, ns. An earlier time has no effect.
    pub fn advance(&mut self, to: u64) {
        while self.now <= to {
            let fault = self.faults.script().next_time().unwrap_or(NEVER);
            // The next event that can concern several buses.
            let common = fault.min(self.line.next_own_event(self.now));
            self.can.run_buses_before(self.now, common.min(to), &mut self.line);
            let next = self.next_event().max(self.now);
            if next > to {
                break;
            }
            self.now = next;
            self.run_instant();
        }
        self.now = self.now.max(to);
        self.can.catch_up(self.now);
    }

    /// Executes everything that is due now. What results from it at the same instant is executed by
    /// the next call.
    fn run_instant(&mut self) {
        let now = self.now;
        self.can.begin_instant();
        while let Some(fault) = self.faults.script_mut().due_time(now) {
            self.inject(fault);
        }
        for index in 0..self.gateway_count() {
            if self.line.run_gateway(index, now) {
                self.update_gateway(index);
            }
        }
        self.can.end_instant(now, &mut self.line);
    }

    /// Begins a send with process data: counts it and applies scripted faults.
    pub(crate) fn begin_cycle(&mut self) -> CycleFaults {
        self.cycle += 1;
        if self.faults.script().op_at().is_none() && self.line.are_all_in_op() {
            self.faults.script_mut().begin_op(self.now);
        }
        while let Some(fault) = self.faults.script_mut().due_cycle(self.cycle) {
            self.inject(fault);
        }
        self.faults.take_cycle_faults()
    }

    /// Sets the start of the simulation, to which the times of scripted faults refer.
    pub(crate) fn begin(&mut self, faults: &[ScriptedFault]) {
        self.start = self.now;
        for fault in faults {
            self.schedule(fault.clone());
        }
    }

    pub(crate) fn fault_schedule(&self) -> &FaultSchedule {
        &self.faults
    }

    pub(crate) fn fault_schedule_mut(&mut self) -> &mut FaultSchedule {
        &mut self.faults
    }

    /// Adds a fault to the script.
    pub fn schedule(&mut self, fault: ScriptedFault) {
        self.faults.script_mut().add(self.start, fault);
    }

    /// The faults that are scheduled and have not taken effect.
    pub fn pending_faults(&self) -> impl Iterator<Item = ScriptedFault> {
        self.faults.script().pending(self.start)
    }

    /// Nanoseconds from the start of the simulation until all gateways were in OP for the first time.
    pub fn op_ns(&self) -> Option<u64> {
        self.faults.script().op_at().map(|at| at.saturating_sub(self.start))
    }

    /// As [`op_ns`](Self::op_ns), until the program had all gateways ready.
    pub fn ready_ns(&self) -> Option<u64> {
        self.faults.script().ready_at().map(|at| at.saturating_sub(self.start))
    }

    /// The program has all gateways ready.
    pub(crate) fn begin_ready(&mut self) {
        self.faults.script_mut().begin_ready(self.now);
    }

    /// The last 256 faults that took effect, oldest first.
    pub fn faults(&self) -> impl Iterator<Item = &FaultRecord> {
        self.faults.log().records()
    }

    /// Calls `observer` with each fault at the time it takes effect; replaces the last observer. It
    /// runs on the thread that advances the world, and must not access the simulation.
    pub fn observe_faults(&mut self, observer: impl Fn(&FaultRecord) + Send + 'static) {
        self.faults.log_mut().observe(Box::new(observer));
    }

    /// Injects a fault now. Returns whether it takes effect; then it is the last one of
    /// [`faults`](Self::faults).
    pub fn inject(&mut self, fault: Fault) -> bool {
        let has_effect = self.apply(&fault);
        if has_effect {
            let (time_ns, cycle) = (self.now.saturating_sub(self.start), self.cycle);
            self.faults.log_mut().add(FaultRecord { time_ns, cycle, fault });
        }
        has_effect
    }

    /// Returns whether what the fault concerns exists.
    fn apply(&mut self, fault: &Fault) -> bool {
        let now = self.now;
        match *fault {
            Fault::LostFrame { direction, cycles } => self.faults.lose_frames(direction, cycles),
            Fault::WorkingCounterOffset { offset, cycles } => {
                self.faults.offset_counters(offset, cycles);
            }
            Fault::PowerCycle { gateway, off_ms } => {
                return self.switch_off(gateway, Some(now + ms(off_ms)));
            }
            Fault::PowerOff { gateway } => return self.switch_off(gateway, None),
            Fault::PowerOn { gateway } => {
                let has_effect = self.line.switch_on(gateway, now);
                if has_effect {
                    self.update_gateway(gateway);
                }
                return has_effect;
            }
            Fault::LinkLoss { gateway, for_ms } => {
                return self.line.open_cable(gateway, now + ms(for_ms));
            }
            Fault::IoPowerCycle { io, off_ms } => {
                return self.line.switch_io_off(io, now + ms(off_ms));
            }
            Fault::Gateway { gateway, fault } => {
                let inject = self.with_gateway(gateway, |gateway, now| gateway.inject(now, fault));
                return inject.is_some();
            }
            Fault::BusOff { gateway, channel } => {
                let fault = BusFault::BusOff;
                return self.can.bus_fault(now, &mut self.line, gateway, channel, fault);
            }
            Fault::ErrorFrames { gateway, channel, frames: count } => {
                let fault = |station| BusFault::ErrorFrames { station, count };
                return self.can.bus_fault(now, &mut self.line, gateway, channel, fault);
            }
            Fault::NodeSilent { ref node, for_ms } => {
                return self.can.silence_node(node, now + ms(for_ms));
            }
            Fault::Drive { ref node, fault } => return self.can.drive_fault(now, node, fault),
            Fault::LibraryError { call, errno, times } => {
                self.faults.fail_calls(call, errno, times);
            }
            Fault::RequestsHeld { for_ms } => self.faults.hold_requests(now + ms(for_ms)),
        }
        true
    }

    fn switch_off(&mut self, gateway: usize, on_at: Option<u64>) -> bool {
        let exists = self.line.switch_off(gateway, self.now, on_at);
        if exists {
            self.update_gateway(gateway);
        }
        exists
    }
}
