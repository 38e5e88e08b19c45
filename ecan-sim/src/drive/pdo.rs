//! PDOs of a drive: mapping, transmission, the rules for writing their parameters (CiA 301, 7.5.2.35 to 7.5.2.38),
//! scanner lists (7.5.2.41), and the set of received CAN IDs.

use ecan_canopen::{
    CobId, DataType, MappingEntry, Mpdo, NmtState, NodeId, PdoCobId, ScannerEntry,
    TransmissionType, object,
};
use ecan_protocol::can::CanId;
use ecan_protocol::object::AbortCode;

use super::config::DriveQuirks;
use super::dictionary::{Dictionary, Slot, mapped_bits};
use super::objects::PDO_ENTRIES;
use crate::event_queue::earliest;

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

/// PDO parameters: communication at 0x1400 and 0x1800, mapping at 0x1600 and 0x1A00.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PdoObject {
    pub(super) is_sent: bool,
    is_mapping: bool,
    pub(super) number: u16,
}

impl PdoObject {
    pub(super) fn of(index: u16) -> Option<Self> {
        (object::RPDO_COMMUNICATION..object::TPDO_MAPPING + 0x200).contains(&index).then_some(
            Self {
                is_sent: index >= object::TPDO_COMMUNICATION,
                is_mapping: index & 0x200 != 0,
                number: index & 0x1FF,
            },
        )
    }

    const fn communication(self) -> u16 {
        let first =
            if self.is_sent { object::TPDO_COMMUNICATION } else { object::RPDO_COMMUNICATION };
        first + self.number
    }

    pub(super) fn check(
        self,
        objects: &Dictionary,
        state: NmtState,
        quirks: &DriveQuirks,
        (index, subindex): (u16, u8),
        value: u32,
    ) -> Result<(), AbortCode> {
        if !self.is_mapping {
            return self.check_communication(objects, state, subindex, value);
        }
        if quirks.fixed_mapping {
            return Err(AbortCode::READ_ONLY);
        }
        if state == NmtState::Operational {
            return Err(AbortCode::DEVICE_STATE);
        }
        let must_be_invalid = quirks.rejects_mapping_while_valid && self.can_be_invalid(objects);
        if must_be_invalid && self.valid_id(objects).is_some() {
            return Err(AbortCode::UNSUPPORTED_ACCESS);
        }
        if subindex == 0 {
            return self.check_count(objects, index, value);
        }
        if objects.number(index, 0).unwrap_or(0) != 0 {
            return Err(AbortCode::SUBINDEX_LOCKED);
        }
        if value != 0 {
            self.check_entry(objects, MappingEntry::from_raw(value))?;
        }
        Ok(())
    }

    /// Returns whether a client can write the COB-ID. Some devices have a constant one.
    fn can_be_invalid(self, objects: &Dictionary) -> bool {
        let slot = objects.find((self.communication(), 1)).ok();
        let object = slot.and_then(|slot| objects.object(slot));
        object.is_none_or(|object| object.access.is_writable())
    }

    fn valid_id(self, objects: &Dictionary) -> Option<CanId> {
        valid_pdo_id(objects.number(self.communication(), 1)? as u32)
    }

    fn check_communication(
        self,
        objects: &Dictionary,
        state: NmtState,
        subindex: u8,
        value: u32,
    ) -> Result<(), AbortCode> {
        match subindex {
            1 => {
                let new = PdoCobId::from_raw(value).ok_or(AbortCode::RANGE)?;
                if new.is_valid && is_restricted(new.id) {
                    return Err(AbortCode::RANGE);
                }
                if state == NmtState::Operational {
                    return Err(AbortCode::DEVICE_STATE);
                }
                // The COB-ID of an existing PDO cannot change.
                if new.is_valid && self.valid_id(objects).is_some_and(|old| old != new.id) {
                    return Err(AbortCode::UNSUPPORTED_ACCESS);
                }
                Ok(())
            }
            2 => match TransmissionType::from_raw(value as u8) {
                // Remote frames are not answered.
                None | Some(TransmissionType::RtrSynchronous | TransmissionType::RtrEvent) => {
                    Err(AbortCode::RANGE)
                }
                Some(_) => Ok(()),
            },
            3 | 6 if self.valid_id(objects).is_some() => Err(AbortCode::UNSUPPORTED_ACCESS),
            _ => Ok(()),
        }
    }

    /// Size of an object in bytes, if this PDO may map it.
    fn check_entry(self, objects: &Dictionary, entry: MappingEntry) -> Result<usize, AbortCode> {
        let bytes = usize::from(entry.bits / 8);
        if !self.is_sent && is_dummy(entry) {
            return Ok(bytes);
        }
        let slot = objects.find((entry.index, entry.subindex))?;
        let object = objects.object(slot).ok_or(AbortCode::NO_OBJECT)?;
        let carries = if self.is_sent { object.can_be_sent() } else { object.can_be_received() };
        if carries && mapped_bits(object.data_type) == Some(entry.bits) {
            Ok(bytes)
        } else {
            Err(AbortCode::NOT_MAPPABLE)
        }
    }

    fn check_count(self, objects: &Dictionary, index: u16, count: u32) -> Result<(), AbortCode> {
        // The drive sends MPDOs in source address mode only, and receives them in the other one only.
        let mode = if self.is_sent { Mpdo::SOURCE_MAPPING } else { Mpdo::DESTINATION_MAPPING };
        if count == u32::from(mode) {
            return Ok(());
        }
        if count as usize > PDO_ENTRIES {
            return Err(AbortCode::TOO_GREAT);
        }
        let mut length = 0;
        for subindex in 1..=count as u8 {
            let raw = objects.number(index, subindex).ok_or(AbortCode::RANGE)?;
            length += self.check_entry(objects, MappingEntry::from_raw(raw as u32))?;
        }
        if length > PDO_BYTES { Err(AbortCode::PDO_LENGTH) } else { Ok(()) }
    }
}

/// COB-IDs that CiA 301 reserves for other services.
fn is_restricted(id: CanId) -> bool {
    !id.is_extended()
        && matches!(
            id.raw(),
            0x000..=0x07F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF
                | 0x701..=0x7FF
        )
}

/// A set of CAN IDs. Every frame on the bus is looked up in it.
#[derive(Clone, Debug, Default)]
pub(super) struct CanIdSet {
    pub(super) standard: StandardIds,
    extended: Vec<CanId>,
    version: u32,
}

impl CanIdSet {
    /// CAN IDs of the services that every drive has: NMT, LSS, its SDO server, heartbeats of other nodes,
    /// and its guarding requests.
    pub(super) fn services_of(node: NodeId) -> Self {
        let mut services = Self::default();
        services.insert(CobId::NMT.can_id());
        services.insert(CobId::LSS_REQUEST.can_id());
        services.insert(CobId::sdo_client(node).can_id());
        for producer in (1..=127).filter_map(NodeId::from_raw) {
            services.insert(CobId::heartbeat(producer).can_id());
        }
        services
    }

    /// Changes with every change of the set; 0 at first.
    pub(super) const fn version(&self) -> u32 {
        self.version
    }

    pub(super) fn insert(&mut self, id: CanId) {
        self.version = self.version.wrapping_add(1);
        if id.is_extended() {
            self.extended.push(id);
        } else {
            self.standard.insert(id.raw() as usize);
        }
    }

    pub(super) fn contains(&self, id: CanId) -> bool {
        if id.is_extended() {
            return self.extended.contains(&id);
        }
        self.standard.contains(id.raw() as usize)
    }

    pub(super) fn reset(&mut self, services: &Self) {
        self.version = self.version.wrapping_add(1);
        self.standard = services.standard;
        self.extended.clear();
    }
}

/// Object of the scanner list, with the value that was sent last.
#[derive(Clone, Debug)]
pub(super) struct ScannedObject {
    pub(super) slot: Slot,
    sent: Option<u64>,
}

/// Objects of the scanner list 0x1FA0 that exist and have up to four bytes.
pub(super) fn scanned_objects(objects: &Dictionary) -> Vec<ScannedObject> {
    let count = objects.number(object::SCANNER_LIST, 0).unwrap_or(0).clamp(0, 254) as u8;
    let entries = (1..=count)
        .filter_map(|nth| objects.number(object::SCANNER_LIST, nth))
        .filter_map(|raw| ScannerEntry::from_raw(raw as u32));
    entries
        .flat_map(|entry| {
            (0..entry.count).filter_map(move |nth| {
                let slot = objects.find((entry.index, entry.subindex.checked_add(nth)?)).ok()?;
                let size = objects.object(slot)?.data_type.size()?;
                (size <= 4).then_some(ScannedObject { slot, sent: None })
            })
        })
        .collect()
}

impl ScannedObject {
    /// Returns the value if it changed since it was sent.
    pub(super) fn take_change(&mut self, objects: &Dictionary) -> Option<u64> {
        let value = objects.raw(self.slot);
        (self.sent.replace(value) != Some(value)).then_some(value)
    }

    pub(super) fn restart(&mut self) {
        self.sent = None;
    }
}

const WORD_BITS: usize = 64;
const WORDS: usize = (1 << 11) / WORD_BITS;

/// A set of standard CAN IDs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct StandardIds {
    words: [u64; WORDS],
}

impl StandardIds {
    /// Every standard CAN ID.
    pub(crate) const fn all() -> Self {
        Self { words: [u64::MAX; WORDS] }
    }

    /// Adds an ID; another number than that of a standard ID has no effect.
    pub(crate) fn insert(&mut self, raw: usize) {
        if let Some(bits) = self.words.get_mut(raw / WORD_BITS) {
            *bits |= 1 << (raw % WORD_BITS);
        }
    }

    pub(crate) fn contains(&self, raw: usize) -> bool {
        self.words.get(raw / WORD_BITS).is_some_and(|bits| bits >> (raw % WORD_BITS) & 1 == 1)
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = usize> {
        self.differences(&Self::default())
    }

    /// The IDs that only one of the sets contains.
    pub(crate) fn differences(&self, other: &Self) -> impl Iterator<Item = usize> + use<> {
        let words = self.words.into_iter().zip(other.words).enumerate();
        words.filter(|(_, (own, other))| own != other).flat_map(|(word, (own, other))| {
            let differs = own ^ other;
            (0..WORD_BITS)
                .filter(move |bit| differs >> bit & 1 == 1)
                .map(move |bit| word * WORD_BITS + bit)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_contains_both_formats() {
        let node = NodeId::new(5).unwrap();
        let standard = |raw| CanId::standard(raw).unwrap();
        let services = CanIdSet::services_of(node);
        for (raw, is_in) in [(0, true), (0x605, true), (0x606, false), (0x700, false)] {
            assert_eq!(services.contains(standard(raw)), is_in, "{raw:#X}");
        }
        assert!(services.contains(standard(0x701)) && services.contains(standard(0x77F)));
        let extended = CanId::extended(0x205).unwrap();
        let mut all = CanIdSet::default();
        all.insert(extended);
        assert!(all.contains(extended) && !all.contains(standard(0x205)));
        all.insert(standard(0x205));
        all.reset(&services);
        assert!(!all.contains(extended) && !all.contains(standard(0x205)));
        assert!(all.contains(standard(0x605)));
    }
}
