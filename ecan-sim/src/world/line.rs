//! EtherCAT side of the world: which gateways respond, and the effect of logical datagrams.

use ecan_protocol::device::AlState;
use ecan_protocol::mapping::CHANNELS;

use crate::bus::{ErrorState, StationId};
use crate::fault::{LibraryCall, LossDirection};
use crate::gateway::Gateway;
use crate::io_slave::IoSlave;
use crate::scenario::{GatewaySpec, Scenario, Topology};
use crate::world::fmmu::{Fmmu, LogicalCommand, ProcessDirection};
use crate::world::io_slot::IoSlot;
use crate::world::{NEVER, World};

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
pub(super) fn order(scenario: &Scenario) -> Vec<Slot> {
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

#[derive(Clone)]
pub(super) struct ChannelLink {
    pub(super) bus: usize,
    pub(super) station: StationId,
    /// Configuration generation that the bus has applied.
    pub(super) generation: Option<u32>,
    /// Error state and counters last passed to the gateway.
    pub(super) reported: (ErrorState, u16, u16),
    /// All errors of the station, and those that raised a counter.
    pub(super) errors_reported: (u64, u64),
}

impl ChannelLink {
    pub(super) fn new(bus: usize, station: StationId) -> Self {
        let reported = (ErrorState::Active, 0, 0);
        Self { bus, station, generation: None, reported, errors_reported: (0, 0) }
    }
}

#[derive(Clone)]
pub(super) struct LineSlot {
    pub(super) gateway: Gateway,
    pub(super) spec: GatewaySpec,
    pub(super) fmmus: Vec<Fmmu>,
    pub(super) links: [ChannelLink; CHANNELS],
    /// Time at which the supply returns.
    pub(super) power_on_at: Option<u64>,
    /// Time until which the cable towards the master is open.
    pub(super) cable_open_until: u64,
    /// Number of supply losses: a station address does not survive one.
    pub(super) generation: u32,
    /// Time of the gateway's next event; 0 if an access may have changed it since the last update.
    pub(super) due: u64,
    /// Time at which it runs for that: later than the last update.
    pub(super) next: u64,
    /// The gateway's own event count at the last update; `None` forces an update.
    pub(super) acts_seen: Option<u64>,
}

impl LineSlot {
    pub(super) fn new(gateway: Gateway, spec: GatewaySpec, links: [ChannelLink; CHANNELS]) -> Self {
        Self {
            gateway,
            spec,
            fmmus: Vec::with_capacity(8),
            links,
            power_on_at: None,
            cable_open_until: 0,
            generation: 0,
            due: NEVER,
            next: NEVER,
            acts_seen: None,
        }
    }
}

impl LineSlot {
    /// Returns whether the gateway has nothing to do at that time, and nothing since the last update.
    pub(super) fn is_idle_at(&self, now: u64) -> bool {
        self.due > now && self.acts_seen == Some(self.gateway.acts)
    }
}

/// Effect of the faults on the frames of one send.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct CycleFaults {
    pub(crate) lost: Option<LossDirection>,
    pub(crate) counter_offset: i32,
}

impl World {
    /// Returns whether the master's own link is up.
    pub(crate) fn link_is_up(&self) -> bool {
        match (self.topology, self.line.first()) {
            (Topology::Line, Some(Slot::Gateway(first))) => {
                self.slots.get(*first).is_none_or(|slot| slot.cable_open_until <= self.now)
            }
            _ => true,
        }
    }

    /// Returns whether the cable of a gateway towards the master is open ([`Fault::LinkLoss`]).
    ///
    /// [`Fault::LinkLoss`]: crate::Fault::LinkLoss
    pub fn is_cable_open(&self, gateway: usize) -> bool {
        self.slots.get(gateway).is_some_and(|slot| slot.cable_open_until > self.now)
    }

    /// Position on the line of a gateway.
    pub fn position_of(&self, gateway: usize) -> Option<usize> {
        self.line.iter().position(|slot| *slot == Slot::Gateway(gateway))
    }

    /// Index of the gateway at a position of the line, from 0; `None` for an I/O slave.
    pub fn gateway_at(&self, position: usize) -> Option<usize> {
        self.line.get(position).and_then(|slot| slot.gateway())
    }

    /// Returns whether a frame of the master reaches this gateway and returns: it has booted and
    /// its cable is connected, and in a line the same holds for all slaves before it.
    pub fn is_reachable(&self, index: usize) -> bool {
        self.reaches(Slot::Gateway(index))
    }

    /// As [`is_reachable`](Self::is_reachable), for any slave.
    pub(crate) fn reaches(&self, slot: Slot) -> bool {
        let responds = |slot: &Slot| match *slot {
            Slot::Gateway(index) => self.slots.get(index).is_some_and(|slot| {
                slot.cable_open_until <= self.now && slot.gateway.is_responding()
            }),
            Slot::Io(index) => self.io(index).is_some_and(|io| io.is_responding(self.now)),
        };
        match self.topology {
            Topology::Star => responds(&slot),
            Topology::Line => {
                let mut until = self.line.iter().take_while(|other| **other != slot);
                until.all(responds) && responds(&slot)
            }
        }
    }

    /// The slaves that respond, in the order of their positions.
    pub(crate) fn reached(&self) -> impl Iterator<Item = Slot> {
        self.line.iter().copied().filter(|slot| self.reaches(*slot))
    }

    pub(crate) fn generation(&self, slot: Slot) -> u32 {
        match slot {
            Slot::Gateway(index) => self.slots.get(index).map_or(0, |slot| slot.generation),
            Slot::Io(index) => self.ios.get(index).map_or(0, |slot| slot.generation),
        }
    }

    /// The gateway, if the slave is one.
    pub(crate) fn gateway_in(&self, slot: Slot) -> Option<&Gateway> {
        self.gateway(slot.gateway()?)
    }

    /// Changes the gateway, if the slave is one.
    pub(crate) fn with_gateway_in<R>(
        &mut self,
        slot: Slot,
        change: impl FnOnce(&mut Gateway, u64) -> R,
    ) -> Option<R> {
        self.with_gateway(slot.gateway()?, change)
    }

    /// The I/O, if the slave is one.
    pub(crate) fn io_in(&self, slot: Slot) -> Option<&IoSlave> {
        match slot {
            Slot::Gateway(_) => None,
            Slot::Io(index) => self.io(index),
        }
    }

    /// Changes the I/O, if the slave is one.
    pub(crate) fn io_in_mut(&mut self, slot: Slot) -> Option<&mut IoSlave> {
        match slot {
            Slot::Gateway(_) => None,
            Slot::Io(index) => self.io_mut(index),
        }
    }

    /// The master requests an AL state of a slave.
    pub(crate) fn request_al_state(&mut self, slot: Slot, state: AlState) {
        self.with_gateway_in(slot, |gateway, now| gateway.request_al_state(now, state));
        if let Some(io) = self.io_in_mut(slot) {
            io.request_al_state(state);
        }
    }

    pub(crate) fn al_status_code(&self, slot: Slot) -> u16 {
        match slot {
            Slot::Gateway(index) => self.gateway(index).map_or(0, Gateway::al_status_code),
            Slot::Io(index) => self.io(index).map_or(0, IoSlave::al_status_code),
        }
    }

    pub(crate) fn set_fmmus(&mut self, slot: Slot, fmmus: impl IntoIterator<Item = Fmmu>) {
        let target = match slot {
            Slot::Gateway(index) => self.slots.get_mut(index).map(|slot| &mut slot.fmmus),
            Slot::Io(index) => self.ios.get_mut(index).map(|slot| &mut slot.fmmus),
        };
        if let Some(target) = target {
            target.clear();
            target.extend(fmmus);
        }
    }

    /// Error number of this call of the library, if a fault makes it fail.
    pub(crate) fn library_call(&mut self, call: LibraryCall) -> Result<(), i32> {
        match self.library_errors.get_mut(call as usize) {
            Some((errno, times)) if *times > 0 => {
                *times -= 1;
                Err(*errno)
            }
            _ => Ok(()),
        }
    }

    /// Time from which the master starts requests again, if a fault prevents it now.
    pub(crate) fn requests_held_until(&self) -> Option<u64> {
        (self.requests_held_until > self.now).then_some(self.requests_held_until)
    }

    /// Begins a send with process data: counts it and applies scripted faults.
    pub(crate) fn begin_cycle(&mut self) -> CycleFaults {
        self.cycle += 1;
        self.inject_due_cycle();
        let mut faults = CycleFaults::default();
        if self.lost.1 > 0 {
            self.lost.1 -= 1;
            faults.lost = self.lost.0;
        }
        if self.counter_offset.1 > 0 {
            self.counter_offset.1 -= 1;
            faults.counter_offset = self.counter_offset.0;
        }
        faults
    }

    /// Faults of a send without process data.
    pub(crate) fn faults_between_cycles(&self) -> CycleFaults {
        let lost = self.lost.0.filter(|_| self.lost.1 > 0);
        CycleFaults { lost, ..CycleFaults::default() }
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
        let mut counter = 0u16;
        for index in 0..self.slots.len() {
            if !self.is_reachable(index) {
                continue;
            }
            let Some(slot) = self.slots.get_mut(index) else { continue };
            let mut touched = false;
            for fmmu in &slot.fmmus {
                let done =
                    fmmu.exchange(command, logical, data, |direction, part| match direction {
                        ProcessDirection::Output => {
                            slot.gateway.write_outputs_arriving(now, arrival, part)
                        }
                        ProcessDirection::Input => slot.gateway.read_inputs(now, part),
                    });
                touched |= done > 0;
                counter = counter.wrapping_add(done);
            }
            if touched {
                self.update_gateway(index);
            } else {
                slot.due = 0;
            }
        }
        for index in 0..self.ios.len() {
            if !self.reaches(Slot::Io(index)) {
                continue;
            }
            let Some(IoSlot { slave, fmmus, .. }) = self.ios.get_mut(index) else { continue };
            for fmmu in &*fmmus {
                let done =
                    fmmu.exchange(command, logical, data, |direction, part| match direction {
                        ProcessDirection::Output => slave.write_outputs(now, part),
                        ProcessDirection::Input => slave.read_inputs(now, part),
                    });
                counter = counter.wrapping_add(done);
            }
        }
        counter
    }
}
