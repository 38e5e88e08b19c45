//! The SDO server: every access is judged by ecan-protocol's object dictionary table, then by
//! the rules of state and combination that the manual adds (manual 3.1, 5.4, 13).
//!
//! The mapping objects 0x1600.. and 0x1A00.. are read-only, as in an SII that fixes them. Their
//! entries map subindex 1 of the 16-byte data objects ([`ecan_protocol::object::MAPPED_SUBINDEX`]); the
//! manual names no subindex. After power-on all 24 chunks are assigned, as many as the SII's
//! default sync manager size of 3072 bytes holds (manual 5.3).

use ecan_protocol::device::AlState;
use ecan_protocol::mapping::{
    Direction, MAX_MULTIPLIER, assignment_index, buffer_offset, locate_data_object, pdo_map_index,
};
use ecan_protocol::object::{AbortCode, Entry, Object, ObjectType, object};

use super::Gateway;

/// Name of the device, 0x1008.
const DEVICE_NAME: &str = "ECAN-Lite";

impl Gateway {
    /// SDO upload: puts the entry's bytes into `out`, whatever was in there; empty after an error.
    ///
    /// # Errors
    /// The abort code: no such object or subindex, write-only, wrong state, an injected one, or
    /// a timeout while the mailbox does not answer ([`mailbox_answers`](Self::mailbox_answers)
    /// tells that apart).
    pub fn sdo_upload(
        &mut self,
        now: u64,
        index: u16,
        subindex: u8,
        out: &mut Vec<u8>,
    ) -> Result<(), AbortCode> {
        self.advance(now);
        out.clear();
        let (_, entry) = self.open_transfer(index, subindex)?;
        if !entry.access.can_read() {
            return Err(AbortCode::WRITE_ONLY);
        }
        match entry.ty {
            ObjectType::VisibleString => out.extend_from_slice(self.text(index).as_bytes()),
            ObjectType::String16 => self.read_unit(index, out),
            _ => {
                let value = self.value(index, subindex);
                let bytes = value.to_le_bytes();
                let size = entry.ty.size_bytes().unwrap_or(bytes.len());
                out.extend_from_slice(bytes.get(..size).unwrap_or(&bytes));
            }
        }
        Ok(())
    }

    /// SDO download.
    ///
    /// # Errors
    /// The abort code: no such object or subindex, read-only, wrong length, value out of range,
    /// wrong state, an illegal combination, an injected one, or a timeout while the mailbox
    /// does not answer. Nothing has changed then. Values of objects with an apply command are
    /// taken as they are and judged when applied.
    pub fn sdo_download(
        &mut self,
        now: u64,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), AbortCode> {
        self.advance(now);
        let (object, entry) = self.open_transfer(index, subindex)?;
        if !entry.access.can_write() {
            return Err(AbortCode::READ_ONLY);
        }
        let size = entry.ty.size_bytes().ok_or(AbortCode::UNSUPPORTED_ACCESS)?;
        match data.len() {
            0 => return Err(AbortCode::LENGTH),
            length if length > size => return Err(AbortCode::TOO_LONG),
            length if length < size => return Err(AbortCode::TOO_SHORT),
            _ => {}
        }
        if entry.ty == ObjectType::String16 {
            return self.write_unit(index, data);
        }
        let mut bytes = [0; 4];
        for (to, from) in bytes.iter_mut().zip(data) {
            *to = *from;
        }
        let value = u32::from_le_bytes(bytes);
        if let Some(direction) = assignment_direction(index) {
            return self.assign(direction, subindex, value);
        }
        if is_judged_at_once(object, subindex) {
            check_value(entry, value)?;
        }
        self.check_combination(index, subindex, value)?;
        self.values.set(index, subindex, value);
        self.after_write(index, subindex, value);
        Ok(())
    }

    /// What every transfer begins with: mailbox, injected aborts, object and subindex.
    fn open_transfer(
        &mut self,
        index: u16,
        subindex: u8,
    ) -> Result<(&'static Object, &'static Entry), AbortCode> {
        if !self.mailbox_answers(self.now) {
            return Err(AbortCode::TIMEOUT);
        }
        if self.state == AlState::Boot {
            return Err(AbortCode::DEVICE_STATE);
        }
        if let Some(code) = self.injected_abort(index, subindex) {
            return Err(AbortCode(code));
        }
        let object = object(index).ok_or(AbortCode::NO_OBJECT)?;
        let entry = object.entry(subindex).ok_or(AbortCode::NO_SUBINDEX)?;
        Ok((object, entry))
    }

    fn injected_abort(&mut self, index: u16, subindex: u8) -> Option<u32> {
        let aborts = &mut self.faults.sdo_aborts;
        let at =
            aborts.iter().position(|abort| (abort.index, abort.subindex) == (index, subindex))?;
        let abort = aborts.get_mut(at)?;
        let code = abort.code;
        abort.times = abort.times.saturating_sub(1);
        if abort.times == 0 {
            aborts.remove(at);
        }
        Some(code)
    }

    // Process data objects

    /// The text of a string object.
    pub(crate) fn text(&self, index: u16) -> String {
        let (major, minor) = self.firmware.version();
        match index {
            0x1008 => DEVICE_NAME.to_owned(),
            0x1009 => self.settings.hardware_revision.to_string(),
            _ => format!("{}.{}.{minor}", major >> 8, major & 0xFF),
        }
    }

    /// The bytes of a 16-byte unit as they lie in the sync manager's memory.
    fn read_unit(&self, index: u16, out: &mut Vec<u8>) {
        let unit = locate_data_object(index).and_then(|(direction, chunk, unit)| {
            let memory = match direction {
                Direction::TxPdo => self.inputs.memory(),
                Direction::RxPdo => self.outputs.memory(),
            };
            let offset = buffer_offset(chunk, unit);
            memory.get(offset..offset + ecan_protocol::mapping::UNIT_BYTES)
        });
        out.extend_from_slice(unit.unwrap_or(&[0; ecan_protocol::mapping::UNIT_BYTES]));
    }

    /// Writing an output unit by SDO changes the memory and, without a complete SM2 write,
    /// sends nothing. While process data are exchanged, SM2 owns the memory.
    fn write_unit(&mut self, index: u16, data: &[u8]) -> Result<(), AbortCode> {
        if self.exchanges_process_data() {
            return Err(AbortCode::DEVICE_STATE);
        }
        if let Some((Direction::RxPdo, chunk, unit)) = locate_data_object(index) {
            self.outputs.store_at(buffer_offset(chunk, unit), data);
        }
        Ok(())
    }

    // PDO assignment

    /// A write to 0x1C12 or 0x1C13: in PREOP and SAFEOP only, a chunk only while the count is
    /// 0, and only maps of the direction.
    fn assign(&mut self, direction: Direction, subindex: u8, value: u32) -> Result<(), AbortCode> {
        if !matches!(self.state, AlState::PreOp | AlState::SafeOp) {
            return Err(AbortCode::DEVICE_STATE);
        }
        let index = assignment_index(direction);
        if subindex == 0 {
            if value > u32::from(MAX_MULTIPLIER) {
                return Err(AbortCode::TOO_GREAT);
            }
        } else {
            if self.values.get(index, 0) != 0 {
                return Err(AbortCode::SUBINDEX_LOCKED);
            }
            let first = u32::from(pdo_map_index(direction, 0));
            if !(first..first + u32::from(MAX_MULTIPLIER)).contains(&value) {
                return Err(AbortCode::NOT_MAPPABLE);
            }
        }
        self.values.set(index, subindex, value);
        Ok(())
    }

    /// How many chunks are assigned; `None` when they are not the first so many in order, so
    /// that no multiplier describes them.
    pub(super) fn assigned_chunks(&self, direction: Direction) -> Option<u8> {
        let index = assignment_index(direction);
        let count = self.values.get_u8(index, 0);
        (0..count)
            .all(|chunk| {
                self.values.get(index, chunk + 1) == u32::from(pdo_map_index(direction, chunk))
            })
            .then_some(count)
    }
}

fn assignment_direction(index: u16) -> Option<Direction> {
    Direction::ALL.into_iter().find(|&direction| assignment_index(direction) == index)
}

/// Whether a value out of range is refused with the write. Fields of objects with an apply
/// command wait for it, and the register service and the filter editing commands have
/// statuses of their own; commands themselves do not wait.
fn is_judged_at_once(object: &Object, subindex: u8) -> bool {
    match object.first {
        0xA000 => false,
        0x8001 => matches!(subindex, 1 | 3),
        0x8010 | 0x8011 => matches!(subindex, 1 | 8),
        _ => object.apply.is_none_or(|apply| apply.command == subindex),
    }
}

fn check_value(entry: &Entry, value: u32) -> Result<(), AbortCode> {
    if value > entry.max {
        Err(AbortCode::TOO_GREAT)
    } else if value < entry.min {
        Err(AbortCode::TOO_SMALL)
    } else if !entry.accepts(value) {
        Err(AbortCode::RANGE)
    } else {
        Ok(())
    }
}
