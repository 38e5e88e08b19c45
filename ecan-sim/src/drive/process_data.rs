//! Processing of PDOs and SYNC.

use ecan_canopen::{NmtState, object, parse_sync};
use ecan_protocol::can::CanId;

use super::axis_commands::ReceivedCommands;
use super::device::{Device, PDO_TOO_LONG, PDO_TOO_SHORT};
use super::dictionary::Slot;
use super::emergency::register_of;
use super::pdo::{Mapping, PDO_BYTES};
use super::slots::{Slots, UPDATED};
use crate::node::NodeOutput;

/// EMCY error code: SYNC with wrong length.
const SYNC_LENGTH: u16 = 0x8240;

impl Device {
    /// Handles a SYNC: inputs are sampled and sent, then waiting outputs are applied.
    pub(super) fn on_sync(&mut self, data: &[u8], out: &mut NodeOutput) {
        let Some(counter) = parse_sync(data) else {
            return self.emergency.report(SYNC_LENGTH, register_of(SYNC_LENGTH), &mut self.objects);
        };
        self.syncs += 1;
        if self.network.state() != NmtState::Operational {
            return;
        }
        self.publish_pdo_objects();
        for place in 0..self.transmit.len() {
            let Some(pdo) = self.transmit.get_mut(place) else { continue };
            let (Some(id), length) = (pdo.id, pdo.mapping.length) else { continue };
            if let Some(packed) = pdo.on_sync(counter, &self.objects) {
                self.send_as(out, id, packed.get(..length).unwrap_or(&packed));
            }
        }
        for place in 0..self.receive.len() {
            let Some(pdo) = self.receive.get_mut(place) else { continue };
            let mapping = pdo.mapping;
            if let Some(waiting) = pdo.waiting.take() {
                self.unpack(&mapping, &waiting);
            }
        }
    }

    /// Sends event-driven PDOs whose objects changed or whose timer expired.
    pub(super) fn send_events(&mut self, out: &mut NodeOutput) {
        for place in 0..self.transmit.len() {
            let Some(pdo) = self.transmit.get_mut(place) else { continue };
            let (Some(id), length) = (pdo.id, pdo.mapping.length) else { continue };
            if let Some(packed) = pdo.on_event(self.now, &self.objects) {
                self.send_as(out, id, packed.get(..length).unwrap_or(&packed));
            }
        }
    }

    /// Receives a PDO.
    pub(super) fn on_pdo(&mut self, id: CanId, data: &[u8]) {
        if self.network.state() != NmtState::Operational {
            return;
        }
        for place in 0..self.receive.len() {
            let Some(pdo) = self.receive.get_mut(place) else { continue };
            if pdo.id != Some(id) {
                continue;
            }
            let (mapping, synchronous) = (pdo.mapping, pdo.synchronous);
            if data.len() < mapping.length {
                let register = register_of(PDO_TOO_SHORT);
                self.emergency.report(PDO_TOO_SHORT, register, &mut self.objects);
                continue;
            }
            pdo.rewind(self.now);
            let mut bytes = [0; PDO_BYTES];
            for (to, from) in bytes.iter_mut().zip(data) {
                *to = *from;
            }
            if synchronous {
                pdo.waiting = Some(bytes);
            }
            if data.len() > mapping.length {
                let register = register_of(PDO_TOO_LONG);
                self.emergency.report(PDO_TOO_LONG, register, &mut self.objects);
            }
            self.received_pdos += 1;
            if !synchronous {
                self.unpack(&mapping, &bytes);
            }
        }
    }

    /// Writes the data of a PDO to the objects; its commands are applied together.
    fn unpack(&mut self, mapping: &Mapping, data: &[u8; PDO_BYTES]) {
        let mut received = ReceivedCommands::default();
        let mut rest = data.iter().copied();
        let mut parameters_changed = false;
        for mapped in mapping.entries() {
            let bytes = rest.by_ref().take(usize::from(mapped.bytes));
            let (raw, _) = bytes
                .fold((0u64, 0), |(raw, shift), byte| (raw | u64::from(byte) << shift, shift + 8));
            let Some(slot) = mapped.slot else { continue };
            if !self.is_within_limits(slot, raw) {
                continue;
            }
            self.objects.put(slot, raw);
            if let Some(object) = self.objects.object(slot) {
                let number = object.data_type.number(raw);
                parameters_changed |= !self.axis.store_command(object.index, number, &mut received);
            }
        }
        if parameters_changed {
            self.load_parameters();
        }
        self.axis.apply(&received, &self.parameters);
    }

    /// Values outside the limits of an object are rejected in PDOs too.
    fn is_within_limits(&self, slot: Slot, raw: u64) -> bool {
        let Some(object) = self.objects.object(slot) else { return false };
        let number = object.data_type.number(object.data_type.cut(raw));
        let (low, high) = object.limits;
        let supported = object.index != object::MODE_OF_OPERATION || self.has_mode(number as i8);
        supported && low.is_none_or(|low| number >= low) && high.is_none_or(|high| number <= high)
    }
}

impl Device {
    /// Updates all objects of the drive.
    pub(super) fn publish(&mut self) {
        let slots = self.slots;
        self.publish_to(&slots);
    }

    /// Updates the objects that transmit PDOs contain.
    pub(super) fn publish_pdo_objects(&mut self) {
        let slots = self.pdo_slots;
        self.publish_to(&slots);
    }

    fn publish_to(&mut self, slots: &Slots) {
        for (slot, index) in slots.iter().zip(UPDATED) {
            if let Some(slot) = slot {
                let value = self.value(index);
                self.objects.put(*slot, value as u64);
            }
        }
    }

    fn value(&self, index: u16) -> i64 {
        let motor = self.axis.motor();
        match index {
            object::ERROR_REGISTER => self.emergency.register().0.into(),
            object::ERROR_CODE => self.emergency.code().into(),
            object::STATUSWORD => self.statusword().0.into(),
            object::MODE_DISPLAY => self.axis.mode().map_or(0, |mode| i64::from(mode.raw())),
            object::POSITION_DEMAND => self.axis.demand().into(),
            object::POSITION_ACTUAL_INTERNAL => motor.position().round() as i64,
            object::POSITION_ACTUAL => self.axis.position().into(),
            object::VELOCITY_DEMAND => self.axis.demanded_velocity().into(),
            object::VELOCITY_ACTUAL => motor.velocity().round() as i64,
            object::TORQUE_DEMAND | object::TORQUE_ACTUAL => motor.torque().round() as i64,
            object::FOLLOWING_ERROR => self.axis.following_error().into(),
            object::DIGITAL_INPUTS => self.axis.switches().bits().into(),
            _ => 0,
        }
    }
}
