//! The object dictionary: objects, access rights and values.

use ecan_canopen::{AccessType, DataType};
use ecan_protocol::object::AbortCode;

/// A value: raw bits of a number, or bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Value {
    Number(u64),
    Bytes(Vec<u8>),
}

/// One subindex.
#[derive(Clone, Debug)]
pub(super) struct Object {
    pub(super) index: u16,
    pub(super) subindex: u8,
    pub(super) data_type: DataType,
    pub(super) access: AccessType,
    pub(super) mappable: bool,
    pub(super) limits: (Option<i64>, Option<i64>),
    /// Value after a reset if none is saved.
    pub(super) default: Value,
    /// Value saved with 0x1010.
    pub(super) saved: Option<Value>,
    pub(super) value: Value,
}

impl Object {
    /// An object without limits that no PDO can contain.
    pub(super) fn new(
        (index, subindex): (u16, u8),
        data_type: DataType,
        access: AccessType,
        default: Value,
    ) -> Self {
        let (value, limits) = (default.clone(), (None, None));
        let (mappable, saved) = (false, None);
        Self { index, subindex, data_type, access, mappable, limits, default, saved, value }
    }

    pub(super) const fn key(&self) -> (u16, u8) {
        (self.index, self.subindex)
    }

    pub(super) const fn can_be_sent(&self) -> bool {
        let is_input = !matches!(self.access, AccessType::WriteOnly | AccessType::ReadWriteOutput);
        self.mappable && is_input && mapped_bits(self.data_type).is_some()
    }

    pub(super) const fn can_be_received(&self) -> bool {
        let is_output =
            !matches!(self.access, AccessType::ReadWriteInput) && self.access.is_writable();
        self.mappable && is_output && mapped_bits(self.data_type).is_some()
    }
}

/// Size of a value in a PDO of the drive, in bits; `None` if it cannot be mapped. A BOOLEAN takes a
/// byte.
pub(super) const fn mapped_bits(data_type: DataType) -> Option<u8> {
    match data_type.size() {
        Some(bytes) => Some(8 * bytes as u8),
        None => None,
    }
}

/// Index and subindex of an object.
pub(super) type Key = (u16, u8);

/// Position of an object in one dictionary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Slot(u16);

/// Maximum size of a value without fixed size.
pub(super) const LONGEST: usize = 65_536;

/// Objects in order of index and subindex.
#[derive(Clone, Debug, Default)]
pub(super) struct Dictionary {
    objects: Vec<Object>,
}

impl Dictionary {
    /// A dictionary of these objects with their defaults. The first of two objects with the same
    /// index and subindex counts.
    pub(super) fn new(mut objects: Vec<Object>) -> Self {
        objects.sort_by_key(Object::key);
        objects.dedup_by_key(|object| object.key());
        objects.truncate(usize::from(u16::MAX));
        Self { objects }
    }

    pub(super) fn find(&self, key: Key) -> Result<Slot, AbortCode> {
        match self.objects.binary_search_by_key(&key, Object::key) {
            Ok(position) => Ok(Slot(position as u16)),
            Err(_) if self.has(key.0) => Err(AbortCode::NO_SUBINDEX),
            Err(_) => Err(AbortCode::NO_OBJECT),
        }
    }

    pub(super) fn has(&self, index: u16) -> bool {
        let first = self.objects.partition_point(|object| object.index < index);
        self.objects.get(first).is_some_and(|object| object.index == index)
    }

    pub(super) fn object(&self, slot: Slot) -> Option<&Object> {
        self.objects.get(usize::from(slot.0))
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut Object> {
        self.objects.iter_mut()
    }

    /// Raw bits of a number; 0 for bytes.
    pub(super) fn raw(&self, slot: Slot) -> u64 {
        match self.object(slot).map(|object| &object.value) {
            Some(Value::Number(raw)) => *raw,
            _ => 0,
        }
    }

    /// Sign-extended number by index and subindex.
    pub(super) fn number(&self, index: u16, subindex: u8) -> Option<i64> {
        let object = self.object(self.find((index, subindex)).ok()?)?;
        match object.value {
            Value::Number(raw) => Some(object.data_type.sign_extend(raw)),
            Value::Bytes(_) => None,
        }
    }

    /// Number of 16 bits without sign, as times have; the nearest one for an object of another type, and
    /// 0 if it does not exist.
    pub(super) fn unsigned16(&self, index: u16, subindex: u8) -> u64 {
        self.number(index, subindex).unwrap_or(0).clamp(0, u16::MAX.into()) as u64
    }

    /// Sets a number without access check; excess bits are cut off.
    pub(super) fn put(&mut self, slot: Slot, raw: u64) {
        if let Some(object) = self.objects.get_mut(usize::from(slot.0))
            && let Value::Number(value) = &mut object.value
        {
            *value = object.data_type.mask(raw);
        }
    }

    /// As [`put`](Self::put) by index and subindex; no effect if the object does not exist.
    pub(super) fn set(&mut self, index: u16, subindex: u8, value: i64) {
        if let Ok(slot) = self.find((index, subindex)) {
            self.put(slot, value as u64);
        }
    }

    /// Reads an object for an SDO upload into `out`.
    pub(super) fn read(&self, slot: Slot, out: &mut Vec<u8>) -> Result<(), AbortCode> {
        let object = self.object(slot).ok_or(AbortCode::NO_OBJECT)?;
        if object.access == AccessType::WriteOnly {
            return Err(AbortCode::WRITE_ONLY);
        }
        out.clear();
        match &object.value {
            Value::Number(raw) => {
                let size = object.data_type.size().unwrap_or(8);
                out.extend(raw.to_le_bytes().into_iter().take(size));
            }
            Value::Bytes(bytes) => out.extend_from_slice(bytes),
        }
        Ok(())
    }

    /// Checks whether an SDO download of `length` bytes is allowed; `None` if the client gives no
    /// size.
    pub(super) fn check_write(&self, slot: Slot, length: Option<usize>) -> Result<(), AbortCode> {
        let object = self.object(slot).ok_or(AbortCode::NO_OBJECT)?;
        if !object.access.is_writable() {
            return Err(AbortCode::READ_ONLY);
        }
        let Some(length) = length else { return Ok(()) };
        match object.data_type.size() {
            Some(size) if length > size => Err(AbortCode::TOO_LONG),
            Some(size) if length < size => Err(AbortCode::TOO_SHORT),
            None if length > LONGEST => Err(AbortCode::TOO_LONG),
            _ => Ok(()),
        }
    }

    /// Decodes a number for an object; `None` for an object of bytes.
    pub(super) fn decode(&self, slot: Slot, data: &[u8]) -> Result<Option<i64>, AbortCode> {
        self.check_write(slot, Some(data.len()))?;
        let object = self.object(slot).ok_or(AbortCode::NO_OBJECT)?;
        if object.data_type.size().is_none() {
            return Ok(None);
        }
        let raw = data.iter().rev().fold(0, |raw, byte| raw << 8 | u64::from(*byte));
        let number = object.data_type.sign_extend(raw);
        let (low, high) = object.limits;
        if matches!(object.data_type, DataType::Boolean) && raw > 1 {
            return Err(AbortCode::RANGE);
        }
        if high.is_some_and(|high| number > high) {
            return Err(AbortCode::TOO_GREAT);
        }
        if low.is_some_and(|low| number < low) {
            return Err(AbortCode::TOO_SMALL);
        }
        Ok(Some(number))
    }

    pub(super) fn put_bytes(&mut self, slot: Slot, data: &[u8]) {
        if let Some(object) = self.objects.get_mut(usize::from(slot.0))
            && let Value::Bytes(bytes) = &mut object.value
        {
            bytes.clear();
            bytes.extend_from_slice(data);
        }
    }
}
