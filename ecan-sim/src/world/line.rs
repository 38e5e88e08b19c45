//! The EtherCAT line: which slaves respond, and the effect of logical datagrams.

use ecan_protocol::device::AlState;

use crate::event_queue::NEVER;
use crate::gateway::Gateway;
use crate::io_slave::IoSlave;
use crate::scenario::{GatewaySpec, IoSpec, Scenario, Topology};
use crate::sii::SlaveDescription;

/// A slave on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Slot {
    /// Index of a gateway.
    Gateway(usize),
    /// Index of an I/O slave.
    Io(usize),
}

impl Slot {
    pub(crate) fn gateway(self) -> Option<usize> {
        match self {
            Self::Gateway(index) => Some(index),
            Self::Io(_) => None,
        }
    }
}

/// The slaves of a scenario by their positions: the I/O slaves at theirs, the gateways at the others.
fn order(scenario: &Scenario) -> Vec<Slot> {
    let mut gateways = (0..scenario.gateways.len()).map(Slot::Gateway);
    let mut ios: Vec<_> = (0..scenario.ios.len()).collect();
    ios.sort_by_key(|index| scenario.ios.get(*index).map(|io| io.position));
    let mut line = Vec::new();
    for index in ios {
        let position = scenario.ios.get(index).map_or(0, |io| io.position);
        let before = position.saturating_sub(line.len());
        line.extend(gateways.by_ref().take(before));
        line.push(Slot::Io(index));
    }
    line.extend(gateways);
    line
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ProcessDirection {
    Output,
    Input,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LogicalCommand {
    /// LRD
    Read,
    /// LWR
    Write,
    /// LRW
    ReadWrite,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Fmmu {
    pub(crate) logical_start: u32,
    /// Length in bytes.
    pub(crate) length: u16,
    pub(crate) sync_manager: u8,
    pub(crate) direction: ProcessDirection,
}

/// A logical datagram on its way through the slaves.
///
/// Reads and writes of a slave count separately: in an LRW a read adds 1 and a write adds 2; a rejected one adds
/// nothing and leaves the data unchanged.
pub(super) struct LogicalDatagram<'a> {
    pub(super) command: LogicalCommand,
    pub(super) logical: u32,
    pub(super) data: &'a mut [u8],
    /// Working counter.
    pub(super) counter: u16,
}

impl LogicalDatagram<'_> {
    /// Exchanges the part that an FMMU maps by `access`, which returns whether it succeeds.
    fn exchange(&mut self, fmmu: &Fmmu, access: impl FnOnce(ProcessDirection, &mut [u8]) -> bool) {
        let weight = match (fmmu.direction, self.command) {
            (ProcessDirection::Output, LogicalCommand::Read)
            | (ProcessDirection::Input, LogicalCommand::Write) => return,
            (ProcessDirection::Output, LogicalCommand::ReadWrite) => 2,
            _ => 1,
        };
        let Some(part) = fmmu.part(self.logical, self.data) else { return };
        if access(fmmu.direction, part) {
            self.counter = self.counter.wrapping_add(weight);
        }
    }
}

impl Fmmu {
    /// The part of a datagram's data that the FMMU maps; none unless the datagram covers all of it.
    fn part<'a>(&self, logical: u32, data: &'a mut [u8]) -> Option<&'a mut [u8]> {
        let from = usize::try_from(self.logical_start.checked_sub(logical)?).ok()?;
        data.get_mut(from..from + usize::from(self.length))
    }
}

/// A gateway on the line, with its supply and its cable.
#[derive(Clone)]
struct LineSlot {
    gateway: Gateway,
    spec: GatewaySpec,
    fmmus: Vec<Fmmu>,
    /// Time at which the supply returns.
    power_on_at: Option<u64>,
    /// Time until which the cable towards the master is open.
    cable_open_until: u64,
    /// Number of supply losses: a station address does not survive one.
    generation: u32,
    /// Time of the gateway's next event; 0 if an access may have changed it since the last update.
    due: u64,
    /// Time at which the gateway runs for its next event: later than the last update.
    next: u64,
    /// The gateway's own event count at the last update; `None` forces an update.
    acts_seen: Option<u64>,
}

impl LineSlot {
    fn is_idle_at(&self, now: u64) -> bool {
        self.due > now && self.acts_seen == Some(self.gateway.acts)
    }

    fn lose_supply(&mut self, now: u64, on_at: Option<u64>) {
        self.gateway.power(now, false);
        self.fmmus.clear();
        self.generation = self.generation.wrapping_add(1);
        self.power_on_at = on_at;
    }
}

#[derive(Clone)]
struct IoSlot {
    slave: IoSlave,
    fmmus: Vec<Fmmu>,
    /// Number of supply losses: a station address does not survive one.
    generation: u32,
}

impl IoSlot {
    fn new(spec: IoSpec, now: u64) -> Self {
        let mut slave = IoSlave::new(spec);
        slave.power(Some(now));
        Self { slave, fmmus: Vec::new(), generation: 0 }
    }
}

/// The slaves of a world in the order of the line.
///
/// A caller that changes a gateway must let the CAN side update it, which ends with
/// [`mark_updated`](Self::mark_updated).
#[derive(Clone)]
pub(crate) struct Line {
    topology: Topology,
    order: Vec<Slot>,
    gateways: Vec<LineSlot>,
    ios: Vec<IoSlot>,
}

impl Line {
    /// The line of a scenario, without gateways.
    pub(super) fn new(scenario: &Scenario, now: u64) -> Self {
        Self {
            topology: scenario.topology,
            order: order(scenario),
            gateways: Vec::with_capacity(scenario.gateways.len()),
            ios: scenario.ios.iter().map(|spec| IoSlot::new(spec.clone(), now)).collect(),
        }
    }

    pub(super) fn add_gateway(&mut self, gateway: Gateway, spec: GatewaySpec) {
        self.gateways.push(LineSlot {
            gateway,
            spec,
            fmmus: Vec::with_capacity(8),
            power_on_at: None,
            cable_open_until: 0,
            generation: 0,
            due: NEVER,
            next: NEVER,
            acts_seen: None,
        });
    }

    pub(crate) fn topology(&self) -> Topology {
        self.topology
    }

    pub(super) fn gateway_count(&self) -> usize {
        self.gateways.len()
    }

    /// A gateway by its index in the scenario.
    pub(super) fn gateway(&self, index: usize) -> Option<&Gateway> {
        self.gateways.get(index).map(|slot| &slot.gateway)
    }

    pub(super) fn gateway_mut(&mut self, index: usize) -> Option<&mut Gateway> {
        self.gateways.get_mut(index).map(|slot| &mut slot.gateway)
    }

    /// The gateway, if the slave is one.
    pub(crate) fn gateway_in(&self, slot: Slot) -> Option<&Gateway> {
        self.gateway(slot.gateway()?)
    }

    pub(super) fn io_count(&self) -> usize {
        self.ios.len()
    }

    /// An I/O slave by its index in the scenario.
    pub(super) fn io(&self, index: usize) -> Option<&IoSlave> {
        self.ios.get(index).map(|slot| &slot.slave)
    }

    pub(super) fn io_mut(&mut self, index: usize) -> Option<&mut IoSlave> {
        self.ios.get_mut(index).map(|slot| &mut slot.slave)
    }

    /// The I/O, if the slave is one.
    pub(crate) fn io_in(&self, slot: Slot) -> Option<&IoSlave> {
        match slot {
            Slot::Gateway(_) => None,
            Slot::Io(index) => self.io(index),
        }
    }

    /// The I/O to change, if the slave is one.
    pub(crate) fn io_in_mut(&mut self, slot: Slot) -> Option<&mut IoSlave> {
        match slot {
            Slot::Gateway(_) => None,
            Slot::Io(index) => self.io_mut(index),
        }
    }

    /// Position on the line of a gateway.
    pub(super) fn position_of(&self, gateway: usize) -> Option<usize> {
        self.order.iter().position(|slot| *slot == Slot::Gateway(gateway))
    }

    pub(super) fn slot_at(&self, position: usize) -> Option<Slot> {
        self.order.get(position).copied()
    }

    /// Returns whether the cable of a gateway towards the master is open.
    pub(super) fn is_cable_open(&self, gateway: usize, now: u64) -> bool {
        self.gateways.get(gateway).is_some_and(|slot| slot.cable_open_until > now)
    }

    /// Returns whether the master's own link is up.
    pub(super) fn link_is_up(&self, now: u64) -> bool {
        match (self.topology, self.order.first()) {
            (Topology::Line, Some(Slot::Gateway(first))) => !self.is_cable_open(*first, now),
            _ => true,
        }
    }

    /// Returns whether a frame of the master reaches this slave and returns.
    pub(super) fn reaches(&self, slot: Slot, now: u64) -> bool {
        let responds = |slot: &Slot| match *slot {
            Slot::Gateway(index) => self
                .gateways
                .get(index)
                .is_some_and(|slot| slot.cable_open_until <= now && slot.gateway.is_responding()),
            Slot::Io(index) => self.io(index).is_some_and(|io| io.is_responding(now)),
        };
        match self.topology {
            Topology::Star => responds(&slot),
            Topology::Line => {
                let mut until = self.order.iter().take_while(|other| **other != slot);
                until.all(responds) && responds(&slot)
            }
        }
    }

    /// The slaves that respond, in the order of their positions.
    pub(super) fn reached(&self, now: u64) -> impl Iterator<Item = Slot> {
        self.order.iter().copied().filter(move |slot| self.reaches(*slot, now))
    }

    pub(crate) fn generation(&self, slot: Slot) -> u32 {
        match slot {
            Slot::Gateway(index) => self.gateways.get(index).map_or(0, |slot| slot.generation),
            Slot::Io(index) => self.ios.get(index).map_or(0, |slot| slot.generation),
        }
    }

    pub(crate) fn al_status_code(&self, slot: Slot) -> u16 {
        match slot {
            Slot::Gateway(index) => self.gateway(index).map_or(0, Gateway::al_status_code),
            Slot::Io(index) => self.io(index).map_or(0, IoSlave::al_status_code),
        }
    }

    /// The SII of a slave.
    pub(crate) fn describe(&self, slot: Slot) -> Option<SlaveDescription> {
        match slot {
            Slot::Gateway(index) => {
                self.gateways.get(index).map(|slot| SlaveDescription::of_gateway(&slot.spec))
            }
            Slot::Io(index) => self.io(index).map(|io| SlaveDescription::of_io(io.spec())),
        }
    }

    pub(crate) fn set_alias(&mut self, slot: Slot, alias: u16) {
        match slot {
            Slot::Gateway(index) => {
                self.gateways.get_mut(index).into_iter().for_each(|slot| slot.spec.alias = alias);
            }
            Slot::Io(index) => {
                self.ios.get_mut(index).into_iter().for_each(|slot| slot.slave.set_alias(alias));
            }
        }
    }

    pub(crate) fn set_fmmus(&mut self, slot: Slot, fmmus: impl IntoIterator<Item = Fmmu>) {
        let target = match slot {
            Slot::Gateway(index) => self.gateways.get_mut(index).map(|slot| &mut slot.fmmus),
            Slot::Io(index) => self.ios.get_mut(index).map(|slot| &mut slot.fmmus),
        };
        if let Some(target) = target {
            target.clear();
            target.extend(fmmus);
        }
    }

    /// Passes a logical datagram through a gateway and adds to its working counter. Returns whether an FMMU has
    /// exchanged data. Outputs count as arrived at `arrival`.
    pub(super) fn exchange_gateway(
        &mut self,
        index: usize,
        now: u64,
        arrival: u64,
        datagram: &mut LogicalDatagram<'_>,
    ) -> bool {
        let Some(LineSlot { gateway, fmmus, due, .. }) = self.gateways.get_mut(index) else {
            return false;
        };
        let before = datagram.counter;
        for fmmu in &*fmmus {
            datagram.exchange(fmmu, |direction, part| match direction {
                ProcessDirection::Output => {
                    let (side, mut firmware) = gateway.ethercat(now);
                    side.write_outputs(arrival, part, &mut firmware)
                }
                ProcessDirection::Input => gateway.read_inputs(now, part),
            });
        }
        let has_exchanged = datagram.counter != before;
        if !has_exchanged {
            *due = 0;
        }
        has_exchanged
    }

    /// Passes a logical datagram through the I/O slaves that respond.
    pub(super) fn exchange_ios(&mut self, now: u64, datagram: &mut LogicalDatagram<'_>) {
        for index in 0..self.ios.len() {
            if !self.reaches(Slot::Io(index), now) {
                continue;
            }
            let Some(IoSlot { slave, fmmus, .. }) = self.ios.get_mut(index) else { continue };
            for fmmu in &*fmmus {
                datagram.exchange(fmmu, |direction, part| match direction {
                    ProcessDirection::Output => slave.write_outputs(now, part),
                    ProcessDirection::Input => slave.read_inputs(now, part),
                });
            }
        }
    }

    /// Removes the supply of a gateway until `on_at`. Returns whether the gateway exists.
    pub(super) fn switch_off(&mut self, index: usize, now: u64, on_at: Option<u64>) -> bool {
        let slot = self.gateways.get_mut(index);
        slot.map(|slot| slot.lose_supply(now, on_at)).is_some()
    }

    /// Returns the supply to a gateway. Returns whether the gateway had none.
    pub(super) fn switch_on(&mut self, index: usize, now: u64) -> bool {
        let Some(slot) = self.gateways.get_mut(index) else { return false };
        if slot.gateway.is_powered() {
            return false;
        }
        slot.power_on_at = None;
        slot.gateway.power(now, true);
        true
    }

    /// Removes the supply of an I/O slave until `on_at`. Returns whether the I/O slave exists.
    pub(super) fn switch_io_off(&mut self, index: usize, on_at: u64) -> bool {
        let Some(slot) = self.ios.get_mut(index) else { return false };
        slot.slave.power(Some(on_at));
        slot.fmmus.clear();
        slot.generation = slot.generation.wrapping_add(1);
        true
    }

    /// Opens the cable before a gateway. Returns whether the gateway exists.
    pub(super) fn open_cable(&mut self, index: usize, until: u64) -> bool {
        let slot = self.gateways.get_mut(index);
        slot.map(|slot| slot.cable_open_until = until).is_some()
    }

    /// Time at which the next gateway runs or gets its supply.
    pub(super) fn next_event(&self) -> u64 {
        let mut next = NEVER;
        for slot in &self.gateways {
            next = next.min(slot.next).min(slot.power_on_at.unwrap_or(NEVER));
        }
        next
    }

    /// Time of the next event that a gateway has by itself; 0 if an access may have changed a gateway.
    pub(super) fn next_own_event(&self, now: u64) -> u64 {
        let mut next = NEVER;
        for slot in &self.gateways {
            let due = if slot.is_idle_at(now) { slot.due } else { 0 };
            next = next.min(due).min(slot.power_on_at.unwrap_or(NEVER));
        }
        next
    }

    /// Runs a gateway up to now. Returns whether the gateway must be updated.
    pub(super) fn run_gateway(&mut self, index: usize, now: u64) -> bool {
        let Some(slot) = self.gateways.get_mut(index) else { return false };
        if slot.power_on_at.is_some_and(|at| at <= now) {
            slot.power_on_at = None;
            slot.gateway.power(now, true);
            slot.next = now;
        }
        let is_due = slot.next <= now;
        if is_due {
            slot.gateway.advance(now);
        }
        is_due
    }

    /// Returns whether a gateway has nothing to do at that time, and has done nothing since the last update.
    pub(super) fn is_idle_at(&self, index: usize, now: u64) -> bool {
        self.gateways.get(index).is_some_and(|slot| slot.is_idle_at(now))
    }

    /// Returns whether a gateway has not acted by itself since the last update.
    pub(super) fn is_unchanged(&self, index: usize) -> bool {
        self.gateways.get(index).is_some_and(|slot| slot.acts_seen == Some(slot.gateway.acts))
    }

    /// Notes that the CAN side has applied all changes of a gateway.
    pub(super) fn mark_updated(&mut self, index: usize, now: u64) {
        if let Some(slot) = self.gateways.get_mut(index) {
            // A gateway with something due now runs at the end of this instant, so that it cannot
            // stop time.
            slot.due = slot.gateway.next_event().unwrap_or(NEVER);
            slot.next = slot.due.max(now + 1);
            slot.acts_seen = Some(slot.gateway.acts);
        }
    }

    /// Lets the next event on a bus of the gateway update all of the gateway.
    pub(super) fn force_update(&mut self, index: usize) {
        if let Some(slot) = self.gateways.get_mut(index) {
            slot.acts_seen = None;
        }
    }

    pub(super) fn are_all_in_op(&self) -> bool {
        self.gateways.iter().all(|slot| slot.gateway.al_state() == AlState::Op)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partly_covered_fmmu_is_ignored() {
        let fmmu = Fmmu {
            logical_start: 100,
            length: 4,
            sync_manager: 2,
            direction: ProcessDirection::Output,
        };
        let mut data = [0, 1, 2, 3, 4, 5, 6, 7];
        assert_eq!(fmmu.part(98, &mut data).as_deref(), Some(&[2, 3, 4, 5][..]));
        assert_eq!(fmmu.part(96, &mut data).as_deref(), Some(&[4, 5, 6, 7][..]));
        assert!(fmmu.part(95, &mut data).is_none());
        assert!(fmmu.part(101, &mut data).is_none());
    }
}
