//! EtherCAT side of the world: which gateways respond, and the effect of logical datagrams.

use ecan_protocol::mapping::CHANNELS;

use crate::bus::{ErrorState, StationId};
use crate::fault::{LibraryCall, LossDirection};
use crate::gateway::Gateway;
use crate::scenario::{GatewaySpec, Topology};
use crate::world::{NEVER, World};

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

impl Fmmu {
    /// The part of a datagram's data that the FMMU maps; none unless the datagram covers all of it.
    fn part<'a>(&self, logical: u32, data: &'a mut [u8]) -> Option<&'a mut [u8]> {
        let from = usize::try_from(self.logical_start.checked_sub(logical)?).ok()?;
        data.get_mut(from..from + usize::from(self.length))
    }
}

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
            next: NEVER,
            acts_seen: None,
        }
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
        match (self.topology, self.slots.first()) {
            (Topology::Line, Some(slot)) => slot.cable_open_until <= self.now,
            _ => true,
        }
    }

    /// Returns whether a frame of the master reaches this gateway and returns: it has booted and
    /// its cable is connected, and in a line the same holds for all gateways before it.
    pub fn is_reachable(&self, index: usize) -> bool {
        let responds =
            |slot: &LineSlot| slot.cable_open_until <= self.now && slot.gateway.is_responding();
        match self.topology {
            Topology::Star => self.slots.get(index).is_some_and(responds),
            Topology::Line => {
                index < self.slots.len() && self.slots.iter().take(index + 1).all(responds)
            }
        }
    }

    pub(crate) fn generation(&self, index: usize) -> u32 {
        self.slots.get(index).map_or(0, |slot| slot.generation)
    }

    pub(crate) fn spec(&self, index: usize) -> Option<&GatewaySpec> {
        self.slots.get(index).map(|slot| &slot.spec)
    }

    pub(crate) fn set_fmmus(&mut self, index: usize, fmmus: impl IntoIterator<Item = Fmmu>) {
        if let Some(slot) = self.slots.get_mut(index) {
            slot.fmmus.clear();
            slot.fmmus.extend(fmmus);
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
        while let Some(fault) = self.script.due_cycle(self.cycle) {
            self.inject(fault);
        }
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
                let Some(part) = fmmu.part(logical, data) else { continue };
                let done = match (fmmu.direction, command) {
                    (ProcessDirection::Output, LogicalCommand::Read)
                    | (ProcessDirection::Input, LogicalCommand::Write) => false,
                    (ProcessDirection::Output, _) => {
                        slot.gateway.write_outputs_arriving(now, arrival, part)
                    }
                    (ProcessDirection::Input, _) => slot.gateway.read_inputs(now, part),
                };
                touched |= done;
                let counts_twice = fmmu.direction == ProcessDirection::Output
                    && command == LogicalCommand::ReadWrite;
                counter = counter.wrapping_add(u16::from(done) + u16::from(done && counts_twice));
            }
            if touched {
                self.update_gateway(index);
            }
        }
        counter
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
