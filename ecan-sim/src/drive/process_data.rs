//! PDOs and SYNC at work.

use ecan_canopen::{NmtState, object, parse_sync};
use ecan_protocol::can::CanId;

use super::axis_commands::ReceivedCommands;
use super::device::{Device, PDO_TOO_LONG, PDO_TOO_SHORT};
use super::dictionary::Slot;
use super::emergency::register_of;
use super::pdo::{Mapping, PDO_BYTES};
use crate::node::NodeOutput;

/// A SYNC with the wrong length.
const SYNC_LENGTH: u16 = 0x8240;

impl Device {
    /// SYNC: inputs are sampled and sent, then outputs that waited for it take effect.
    pub(super) fn on_sync(&mut self, data: &[u8], out: &mut NodeOutput) {
        let Some(counter) = parse_sync(data) else {
            return self.emergency.mention(
                SYNC_LENGTH,
                register_of(SYNC_LENGTH),
                &mut self.objects,
            );
        };
        self.syncs += 1;
        if self.network.state() != NmtState::Operational {
            return;
        }
        self.publish_sent();
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

    /// Sends the event-driven PDOs whose objects have changed or whose timer has run down.
    pub(super) fn send_events(&mut self, out: &mut NodeOutput) {
        for place in 0..self.transmit.len() {
            let Some(pdo) = self.transmit.get_mut(place) else { continue };
            let (Some(id), length) = (pdo.id, pdo.mapping.length) else { continue };
            if let Some(packed) = pdo.on_event(self.now, &self.objects) {
                self.send_as(out, id, packed.get(..length).unwrap_or(&packed));
            }
        }
    }

    /// A PDO has come.
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
                self.emergency.mention(PDO_TOO_SHORT, register, &mut self.objects);
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
                self.emergency.mention(PDO_TOO_LONG, register, &mut self.objects);
            }
            self.received_pdos += 1;
            if !synchronous {
                self.unpack(&mapping, &bytes);
            }
        }
    }

    /// Puts the data of a PDO into the objects; what they command takes effect together.
    fn unpack(&mut self, mapping: &Mapping, data: &[u8; PDO_BYTES]) {
        let mut brought = ReceivedCommands::default();
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
                parameters_changed |= !self.axis.note(object.index, number, &mut brought);
            }
        }
        if parameters_changed {
            self.load_parameters();
        }
        self.axis.take(&brought, &self.parameters);
    }

    /// Values outside an object's limits do not reach it by PDO either.
    fn is_within_limits(&self, slot: Slot, raw: u64) -> bool {
        let Some(object) = self.objects.object(slot) else { return false };
        let number = object.data_type.number(object.data_type.cut(raw));
        let (low, high) = object.limits;
        let supported = object.index != object::MODE_OF_OPERATION || self.has_mode(number as i8);
        supported && low.is_none_or(|low| number >= low) && high.is_none_or(|high| number <= high)
    }
}
