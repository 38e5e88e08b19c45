//! Faults of the world: their schedule, their injection and their log.

use crate::bus::BusFault;
use crate::fault::{Fault, FaultRecord, ScriptedFault};
use crate::world::{World, ms};
use ecan_protocol::device::AlState;

impl World {
    /// Sets the start of the simulation, to which the times of scripted faults refer.
    pub(crate) fn begin(&mut self, faults: &[ScriptedFault]) {
        self.start = self.now;
        for fault in faults {
            self.schedule(fault.clone());
        }
    }

    /// Adds a fault to the script.
    pub fn schedule(&mut self, fault: ScriptedFault) {
        self.script.add(self.start, fault);
    }

    /// Injects a fault now. Returns whether it takes effect; then it is the last one of
    /// [`faults`](Self::faults).
    pub fn inject(&mut self, fault: Fault) -> bool {
        let has_effect = self.apply(&fault);
        if has_effect {
            let (time_ns, cycle) = (self.now.saturating_sub(self.start), self.cycle);
            self.fault_log.add(FaultRecord { time_ns, cycle, fault });
        }
        has_effect
    }

    /// The faults that are scheduled and have not taken effect.
    pub fn pending_faults(&self) -> impl Iterator<Item = ScriptedFault> {
        self.script.pending(self.start)
    }

    /// Nanoseconds from the start of the simulation until all gateways were in OP for the first time.
    pub fn op_ns(&self) -> Option<u64> {
        self.script.op_at().map(|at| at.saturating_sub(self.start))
    }

    /// The last 256 faults that took effect, oldest first.
    pub fn faults(&self) -> impl Iterator<Item = &FaultRecord> {
        self.fault_log.records()
    }

    /// Calls `observer` with each fault at the time it takes effect; replaces the last observer. It
    /// runs on the thread that advances the world, and must not access the simulation.
    pub fn observe_faults(&mut self, observer: impl Fn(&FaultRecord) + Send + 'static) {
        self.fault_log.observe(Box::new(observer));
    }

    /// As [`op_ns`](Self::op_ns), until the program had all gateways ready.
    pub fn ready_ns(&self) -> Option<u64> {
        self.script.ready_at().map(|at| at.saturating_sub(self.start))
    }

    /// The program has all gateways ready.
    pub(crate) fn begin_ready(&mut self) {
        self.script.begin_ready(self.now);
    }

    /// Injects the faults of this cycle.
    pub(super) fn inject_due_cycle(&mut self) {
        if self.script.op_at().is_none() && self.are_all_in_op() {
            self.script.begin_op(self.now);
        }
        while let Some(fault) = self.script.due_cycle(self.cycle) {
            self.inject(fault);
        }
    }

    fn are_all_in_op(&self) -> bool {
        self.slots.iter().all(|slot| slot.gateway.al_state() == AlState::Op)
    }

    /// Returns whether what the fault concerns exists.
    fn apply(&mut self, fault: &Fault) -> bool {
        let now = self.now;
        match *fault {
            Fault::LostFrame { direction, cycles } => self.lost = (Some(direction), cycles),
            Fault::WorkingCounterOffset { offset, cycles } => {
                self.counter_offset = (offset, cycles);
            }
            Fault::PowerCycle { gateway, off_ms } => {
                return self.switch_off(gateway, Some(now + ms(off_ms)));
            }
            Fault::PowerOff { gateway } => return self.switch_off(gateway, None),
            Fault::PowerOn { gateway } => return self.switch_on(gateway),
            Fault::LinkLoss { gateway, for_ms } => {
                let Some(slot) = self.slots.get_mut(gateway) else { return false };
                slot.cable_open_until = now + ms(for_ms);
            }
            Fault::IoPowerCycle { io, off_ms } => return self.switch_io_off(io, now + ms(off_ms)),
            Fault::Gateway { gateway, fault } => {
                let inject = self.with_gateway(gateway, |gateway, now| gateway.inject(now, fault));
                return inject.is_some();
            }
            Fault::BusOff { gateway, channel } => {
                return self.bus_fault(gateway, channel, BusFault::BusOff);
            }
            Fault::ErrorFrames { gateway, channel, frames: count } => {
                let fault = |station| BusFault::ErrorFrames { station, count };
                return self.bus_fault(gateway, channel, fault);
            }
            Fault::NodeSilent { ref node, for_ms } => {
                let slot = self.nodes.iter_mut().find(|slot| slot.name == *node);
                let Some(slot) = slot else { return false };
                slot.muted_until = now + ms(for_ms);
                slot.output.clear();
            }
            Fault::Drive { ref node, fault } => return self.drive_fault(node, fault),
            Fault::LibraryError { call, errno, times } => {
                if let Some(entry) = self.library_errors.get_mut(call as usize) {
                    *entry = (errno, times);
                }
            }
            Fault::RequestsHeld { for_ms } => self.requests_held_until = now + ms(for_ms),
        }
        true
    }

    fn switch_off(&mut self, index: usize, on_at: Option<u64>) -> bool {
        let now = self.now;
        let Some(slot) = self.slots.get_mut(index) else { return false };
        slot.gateway.power(now, false);
        slot.fmmus.clear();
        slot.generation = slot.generation.wrapping_add(1);
        slot.power_on_at = on_at;
        self.update_gateway(index);
        true
    }

    fn switch_on(&mut self, index: usize) -> bool {
        let now = self.now;
        let Some(slot) = self.slots.get_mut(index) else { return false };
        if slot.gateway.is_powered() {
            return false;
        }
        slot.power_on_at = None;
        slot.gateway.power(now, true);
        self.update_gateway(index);
        true
    }
}
