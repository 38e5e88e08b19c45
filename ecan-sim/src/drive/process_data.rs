//! Processing of PDOs and SYNC.

use ecan_canopen::{NmtState, TimeOfDay, object, parse_sync};
use ecan_protocol::can::CanId;

use super::axis_commands::ReceivedCommands;
use super::axis_unit::AxisUnit;
use super::device::{Device, send};
use super::dictionary::{Dictionary, MOST_AXES, Slot, Slots, nearest, split_index};
use super::network::register_of;
use super::pdo::{Mapping, PDO_BYTES, TransmitPdo};
use crate::node::NodeOutput;

/// EMCY error code: PDO with too few bytes.
const PDO_TOO_SHORT: u16 = 0x8210;
/// EMCY error code: PDO with too many bytes.
const PDO_TOO_LONG: u16 = 0x8220;
/// EMCY error code: SYNC with wrong length, or with or without counter against 0x1019.
const SYNC_LENGTH: u16 = 0x8240;

impl Device {
    /// Handles a SYNC: inputs are sampled and sent, then waiting outputs are applied.
    pub(super) fn on_sync(&mut self, data: &[u8], out: &mut NodeOutput) {
        let counter = parse_sync(data).filter(|counter| counter.is_some() == self.has_sync_counter);
        let Some(counter) = counter else {
            return self.report(SYNC_LENGTH);
        };
        self.syncs += 1;
        if self.network.state != NmtState::Operational {
            return;
        }
        self.send_pdos(out, |pdo, objects| pdo.on_sync(counter, objects));
        for index in 0..self.receive.len() {
            let Some(pdo) = self.receive.get_mut(index) else { continue };
            if let Some(waiting) = pdo.waiting.take() {
                let mapping = pdo.mapping;
                self.unpack(&mapping, &waiting);
            }
        }
    }

    /// Handles a TIME message.
    pub(super) fn on_time(&mut self, data: &[u8]) {
        if self.network.communicates()
            && let Some(time) = TimeOfDay::parse(data)
        {
            self.time_of_day = Some(time);
        }
    }

    /// Sends event-driven PDOs whose objects changed or whose timer expired.
    pub(super) fn send_events(&mut self, out: &mut NodeOutput) {
        let now = self.now;
        self.send_pdos(out, |pdo, objects| pdo.on_event(now, objects));
        self.send_scanned(out);
    }

    fn send_pdos(
        &mut self,
        out: &mut NodeOutput,
        due: impl Fn(&mut TransmitPdo, &Dictionary) -> Option<[u8; PDO_BYTES]>,
    ) {
        self.publish_to(|unit| &unit.pdo_slots);
        for pdo in &mut self.transmit {
            if let (Some(id), Some(data)) = (pdo.id, due(pdo, &self.objects)) {
                send(&self.config, out, id, data.get(..pdo.mapping.length).unwrap_or(&data));
            }
        }
    }

    /// Reports a communication error that has already gone.
    pub(super) fn report(&mut self, code: u16) {
        self.emergency.report(code, register_of(code), &mut self.objects);
    }

    /// Stores the data of an RPDO until SYNC. Returns false without effect if the frame has other
    /// consequences.
    pub(super) fn store_pdo(&mut self, id: CanId, data: &[u8]) -> bool {
        let is_broadcast = [self.sync_id, self.time_id].contains(&Some(id));
        // Every other frame samples the objects of event-driven PDOs.
        let only_stores = self.network.state == NmtState::Operational && !self.has_event_pdos;
        if !only_stores || is_broadcast || self.services.contains(id) {
            return false;
        }
        let mut concerned = self.receive.iter_mut().filter(|pdo| pdo.id == Some(id));
        let (Some(pdo), None) = (concerned.next(), concerned.next()) else { return false };
        if !pdo.only_waits(data.len()) {
            return false;
        }
        pdo.waiting = Some(padded(data));
        self.received_pdos += 1;
        true
    }

    pub(super) fn on_pdo(&mut self, id: CanId, data: &[u8]) {
        if self.network.state != NmtState::Operational {
            return;
        }
        for index in 0..self.receive.len() {
            let Some(pdo) = self.receive.get_mut(index) else { continue };
            if pdo.id != Some(id) {
                continue;
            }
            if pdo.is_multiplexed {
                pdo.restart_timer(self.now);
                self.on_mpdo(data);
                continue;
            }
            let (mapping, synchronous) = (pdo.mapping, pdo.synchronous);
            if data.len() < mapping.length {
                self.report(PDO_TOO_SHORT);
                continue;
            }
            pdo.restart_timer(self.now);
            let bytes = padded(data);
            if synchronous {
                pdo.waiting = Some(bytes);
            }
            if data.len() > mapping.length {
                self.report(PDO_TOO_LONG);
            }
            self.received_pdos += 1;
            if !synchronous {
                self.unpack(&mapping, &bytes);
            }
        }
    }

    /// Writes the data of a PDO to the objects; its commands are applied together.
    fn unpack(&mut self, mapping: &Mapping, data: &[u8; PDO_BYTES]) {
        let mut received = [ReceivedCommands::default(); MOST_AXES];
        let mut parameters_changed = false;
        let mut axes = 0;
        for (mapped, raw) in mapping.unpack(*data) {
            let Some(slot) = mapped.slot else { continue };
            if !self.is_within_limits(slot, raw) {
                continue;
            }
            self.objects.put(slot, raw);
            if let Some(object) = self.objects.object(slot).filter(|_| self.is_drive) {
                let number = object.data_type.sign_extend(raw);
                let (axis, index) = split_index(object.index);
                if let Some(unit) = self.units.get_mut(axis)
                    && let Some(received) = received.get_mut(axis)
                {
                    axes = axes.max(axis + 1);
                    parameters_changed |= !unit.axis.store_command(index, number, received);
                }
            }
        }
        if parameters_changed {
            self.load_parameters();
        }
        for (unit, received) in self.units.iter_mut().zip(&received).take(axes) {
            unit.apply(received);
        }
    }

    /// Values outside the limits of an object are rejected in PDOs too.
    fn is_within_limits(&self, slot: Slot, raw: u64) -> bool {
        let Some(object) = self.objects.object(slot) else { return false };
        let number = object.data_type.sign_extend(object.data_type.mask(raw));
        let (low, high) = object.limits;
        let (axis, index) = split_index(object.index);
        let supported = !self.is_drive
            || index != object::MODE_OF_OPERATION
            || self.has_mode(axis, number as i8);
        supported && low.is_none_or(|low| number >= low) && high.is_none_or(|high| number <= high)
    }
}

impl Device {
    pub(super) fn publish(&mut self) {
        self.publish_to(|unit| &unit.slots);
    }

    fn publish_to(&mut self, slots: impl Fn(&AxisUnit) -> &Slots) {
        for number in 0..self.units.count() {
            let mut position = 0;
            while let Some(unit) = self.units.get(number)
                && let Some(&(slot, index)) = slots(unit).get(position)
            {
                let value = self.updated_value(unit, index);
                self.objects.put(slot, value as u64);
                position += 1;
            }
        }
    }

    /// Value of an object that the drive updates, by its index for the first axis.
    fn updated_value(&self, unit: &AxisUnit, index: u16) -> i64 {
        let axis = &unit.axis;
        match index {
            object::ERROR_REGISTER => self.emergency.register.into(),
            object::ERROR_CODE => self.emergency.code.into(),
            object::STATUSWORD => self.statusword(unit).0.into(),
            object::MODE_DISPLAY => axis.mode.map_or(0, |mode| mode.raw().into()),
            object::POSITION_DEMAND => axis.demand().into(),
            object::POSITION_ACTUAL_INTERNAL => nearest(axis.motor.position),
            object::POSITION_ACTUAL => axis.position().into(),
            object::VELOCITY_DEMAND => i64::from(axis.motion.ramp.velocity as i32),
            object::VELOCITY_ACTUAL => nearest(axis.motor.velocity),
            object::TORQUE_DEMAND => nearest(axis.motor.torque),
            object::TORQUE_ACTUAL => nearest(axis.motor.torque),
            object::FOLLOWING_ERROR => axis.following_error().into(),
            object::DIGITAL_INPUTS => axis.switches().bits().into(),
            object::VL_VELOCITY_DEMAND => axis.rpm(axis.motion.ramp.velocity),
            object::VL_VELOCITY_ACTUAL => axis.rpm(axis.motor.velocity),
            object::PROBE_STATUS => axis.probes.status().into(),
            object::PROBE_1_POSITIVE => axis.probes.position(0, true).into(),
            object::PROBE_1_NEGATIVE => axis.probes.position(0, false).into(),
            object::PROBE_2_POSITIVE => axis.probes.position(1, true).into(),
            object::PROBE_2_NEGATIVE => axis.probes.position(1, false).into(),
            _ => 0,
        }
    }
}

fn padded(data: &[u8]) -> [u8; PDO_BYTES] {
    let mut bytes = [0; PDO_BYTES];
    for (to, from) in bytes.iter_mut().zip(data) {
        *to = *from;
    }
    bytes
}
