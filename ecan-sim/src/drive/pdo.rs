use ecan_canopen::{DataType, MappingEntry, Mpdo, PdoCobId, TransmissionType, object};
use ecan_protocol::can::CanId;

use super::default_objects::PDO_ENTRIES;
use super::dictionary::{Dictionary, Slot, mapped_bits};
use super::scanner_list::{ScannedObject, scanned_objects};
use crate::earliest::earliest;

pub(super) const PDO_BYTES: usize = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Mapped {
    /// `None` is a dummy entry of a receive PDO.
    pub(super) slot: Option<Slot>,
    pub(super) bytes: u8,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Mapping {
    entries: [Option<Mapped>; PDO_ENTRIES],
    /// In bytes.
    pub(super) length: usize,
}

impl Mapping {
    fn load(objects: &Dictionary, index: u16) -> Self {
        let mut mapping = Self::default();
        let count = objects.number(index, 0).unwrap_or(0);
        if is_multiplexed(count) {
            return mapping;
        }
        for (entry, subindex) in mapping.entries.iter_mut().zip(1u8..) {
            if i64::from(subindex) > count {
                break;
            }
            let raw = objects.number(index, subindex).unwrap_or(0) as u32;
            let mapped = MappingEntry::from_raw(raw);
            let bytes = mapped.bits / 8;
            if mapping.length + usize::from(bytes) > PDO_BYTES {
                break;
            }
            let slot = objects.find((mapped.index, mapped.subindex)).ok();
            *entry = Some(Mapped { slot, bytes });
            mapping.length += usize::from(bytes);
        }
        mapping
    }

    pub(super) fn entries(&self) -> impl Iterator<Item = Mapped> {
        self.entries.iter().map_while(|entry| *entry)
    }

    /// The entries with their raw bits in the data of a PDO.
    pub(super) fn unpack(&self, data: [u8; PDO_BYTES]) -> impl Iterator<Item = (Mapped, u64)> {
        let mut rest = u64::from_le_bytes(data);
        self.entries().map(move |mapped| {
            let bits = 8 * u32::from(mapped.bytes);
            let raw = rest & !u64::MAX.checked_shl(bits).unwrap_or(0);
            rest = rest.checked_shr(bits).unwrap_or(0);
            (mapped, raw)
        })
    }

    pub(super) fn has(&self, slot: Slot) -> bool {
        self.entries().any(|mapped| mapped.slot == Some(slot))
    }

    pub(super) fn pack(&self, objects: &Dictionary) -> [u8; PDO_BYTES] {
        let (mut data, mut position) = (0u64, 0);
        for mapped in self.entries() {
            let raw = mapped.slot.map_or(0, |slot| objects.raw(slot));
            let bits = 8 * u32::from(mapped.bytes);
            let raw = raw & !u64::MAX.checked_shl(bits).unwrap_or(0);
            data |= raw.checked_shl(position).unwrap_or(0);
            position += bits;
        }
        data.to_le_bytes()
    }
}

/// Returns whether a number of mapped objects is that of an MPDO.
pub(super) fn is_multiplexed(count: i64) -> bool {
    [Mpdo::SOURCE_MAPPING, Mpdo::DESTINATION_MAPPING]
        .into_iter()
        .any(|mode| i64::from(mode) == count)
}

/// Returns whether a mapping entry is a dummy: the index of a data type.
pub(super) fn is_dummy(entry: MappingEntry) -> bool {
    entry.subindex == 0
        && (1..=7).contains(&entry.index)
        && mapped_bits(DataType::from_index(entry.index)) == Some(entry.bits)
}

pub(super) fn numbers(objects: &Dictionary, first: u16) -> impl Iterator<Item = u16> {
    (0..512).filter(move |number| objects.has(first + number))
}

#[derive(Clone, Debug)]
pub(super) struct ReceivePdo {
    pub(super) number: u16,
    /// `None` while the PDO does not exist.
    pub(super) id: Option<CanId>,
    pub(super) synchronous: bool,
    pub(super) is_multiplexed: bool,
    pub(super) mapping: Mapping,
    /// Data that wait for SYNC.
    pub(super) waiting: Option<[u8; PDO_BYTES]>,
    timer_ns: u64,
    /// Time at which it is late; `None` until the first one arrives.
    pub(super) deadline: Option<u64>,
}

impl ReceivePdo {
    pub(super) fn load(objects: &Dictionary, number: u16) -> Self {
        let communication = object::RPDO_COMMUNICATION + number;
        let get = |subindex| objects.number(communication, subindex).unwrap_or(0);
        let kind = TransmissionType::from_raw(get(2) as u8);
        let mapping_index = object::RPDO_MAPPING + number;
        let mapping = Mapping::load(objects, mapping_index);
        let is_multiplexed = is_multiplexed(objects.number(mapping_index, 0).unwrap_or(0));
        Self {
            number,
            id: valid_pdo_id(get(1) as u32).filter(|_| is_multiplexed || mapping.length > 0),
            is_multiplexed,
            synchronous: kind.is_some_and(TransmissionType::is_synchronous),
            mapping,
            waiting: None,
            timer_ns: objects.unsigned16(communication, 5) * 1_000_000,
            deadline: None,
        }
    }

    pub(super) const fn is_timed(&self) -> bool {
        self.timer_ns > 0
    }

    /// Returns whether data of this length have no effect before SYNC.
    pub(super) const fn only_waits(&self, length: usize) -> bool {
        self.synchronous
            && !self.is_multiplexed
            && !self.is_timed()
            && length == self.mapping.length
    }

    pub(super) fn restart_timer(&mut self, now: u64) {
        self.deadline = (self.timer_ns > 0).then(|| now.saturating_add(self.timer_ns));
    }
}

/// CAN ID of an existing PDO.
pub(super) fn valid_pdo_id(raw: u32) -> Option<CanId> {
    PdoCobId::from_raw(raw).filter(|cob_id| cob_id.is_valid).map(|cob_id| cob_id.id)
}

#[derive(Clone, Debug)]
pub(super) struct TransmitPdo {
    pub(super) number: u16,
    /// `None` while the PDO does not exist.
    pub(super) id: Option<CanId>,
    kind: TransmissionType,
    pub(super) mapping: Mapping,
    /// Objects of an MPDO; empty for another PDO.
    scanned: Vec<ScannedObject>,
    inhibit_ns: u64,
    timer_ns: u64,
    sync_start: u8,
    /// SYNC messages since the last transmission; `None` until the start value was received.
    syncs: Option<u8>,
    last: Option<[u8; PDO_BYTES]>,
    free_at: u64,
    timer_at: Option<u64>,
}

impl TransmitPdo {
    pub(super) fn load(objects: &Dictionary, number: u16) -> Self {
        let communication = object::TPDO_COMMUNICATION + number;
        let get = |subindex| objects.number(communication, subindex).unwrap_or(0);
        let mapping_index = object::TPDO_MAPPING + number;
        let mapping = Mapping::load(objects, mapping_index);
        let is_multiplexed = is_multiplexed(objects.number(mapping_index, 0).unwrap_or(0));
        let scanned = if is_multiplexed { scanned_objects(objects) } else { Vec::new() };
        let sync_start = get(6) as u8;
        Self {
            number,
            id: valid_pdo_id(get(1) as u32).filter(|_| is_multiplexed || mapping.length > 0),
            scanned,
            kind: TransmissionType::from_raw(get(2) as u8)
                .unwrap_or(TransmissionType::EventProfile),
            mapping,
            inhibit_ns: objects.unsigned16(communication, 3) * 100_000,
            timer_ns: objects.unsigned16(communication, 5) * 1_000_000,
            sync_start,
            syncs: None,
            last: None,
            free_at: 0,
            timer_at: None,
        }
    }

    /// Handles entering Operational: event-driven PDOs are sent once, counters start.
    pub(super) fn start(&mut self) {
        self.last = None;
        self.scanned.iter_mut().for_each(ScannedObject::restart);
        self.free_at = 0;
        self.timer_at = None;
        self.syncs = None;
    }

    pub(super) const fn is_event_driven(&self) -> bool {
        self.id.is_some()
            && matches!(
                self.kind,
                TransmissionType::EventManufacturer | TransmissionType::EventProfile
            )
    }

    /// Handles a SYNC with its counter, if any. Returns the data if the PDO is due.
    pub(super) fn on_sync(
        &mut self,
        counter: Option<u8>,
        objects: &Dictionary,
    ) -> Option<[u8; PDO_BYTES]> {
        self.id?;
        match self.kind {
            TransmissionType::SynchronousAcyclic => {
                let data = self.mapping.pack(objects);
                (self.last.replace(data) != Some(data)).then_some(data)
            }
            TransmissionType::Synchronous(every) => {
                let syncs = match (self.syncs, counter) {
                    (Some(syncs), _) => syncs + 1,
                    // The start value selects the SYNC that counts as the first.
                    (None, Some(counter)) if self.sync_start > 0 => {
                        if counter != self.sync_start {
                            return None;
                        }
                        every
                    }
                    (None, _) => 1,
                };
                let due = syncs >= every;
                self.syncs = Some(if due { 0 } else { syncs });
                due.then(|| self.mapping.pack(objects))
            }
            _ => None,
        }
    }

    pub(super) fn on_event(&mut self, now: u64, objects: &Dictionary) -> Option<[u8; PDO_BYTES]> {
        if !self.is_event_driven() || self.mapping.length == 0 || self.free_at > now {
            return None;
        }
        let data = self.mapping.pack(objects);
        let timed = self.timer_at.is_some_and(|at| at <= now);
        if self.last == Some(data) && !timed {
            return None;
        }
        self.last = Some(data);
        self.free_at = now.saturating_add(self.inhibit_ns);
        self.timer_at = (self.timer_ns > 0).then(|| now.saturating_add(self.timer_ns));
        Some(data)
    }

    /// Returns the next object of an MPDO whose value changed, unless the inhibit time runs.
    pub(super) fn next_scanned(&mut self, now: u64, objects: &Dictionary) -> Option<(Slot, u64)> {
        if !self.is_event_driven() || self.free_at > now {
            return None;
        }
        let changed = self
            .scanned
            .iter_mut()
            .find_map(|scanned| scanned.take_change(objects).map(|value| (scanned.slot, value)))?;
        self.free_at = now.saturating_add(self.inhibit_ns);
        Some(changed)
    }

    /// Returns whether the PDO contains an object.
    pub(super) fn has(&self, slot: Slot) -> bool {
        self.mapping.has(slot) || self.scanned.iter().any(|scanned| scanned.slot == slot)
    }

    /// Time at which the PDO may become due without another event.
    pub(super) fn next_event(&self, now: u64) -> Option<u64> {
        if !self.is_event_driven() {
            return None;
        }
        let inhibited = (self.free_at > now).then_some(self.free_at);
        let timer = self.timer_at.map(|at| at.max(self.free_at));
        earliest([inhibited, timer])
    }
}
