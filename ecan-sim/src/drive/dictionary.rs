//! The object dictionary: objects, access rights and values, and the distance of the objects of further axes (CiA
//! 402-1: logical devices).

use ecan_canopen::{AccessType, DataType, object};
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

const COUNT: usize = 20;

/// Indices for the first axis.
const UPDATED_OBJECTS: [u16; COUNT] = [
    object::ERROR_REGISTER,
    object::ERROR_CODE,
    object::STATUSWORD,
    object::MODE_DISPLAY,
    object::POSITION_DEMAND,
    object::POSITION_ACTUAL_INTERNAL,
    object::POSITION_ACTUAL,
    object::VELOCITY_DEMAND,
    object::VELOCITY_ACTUAL,
    object::TORQUE_DEMAND,
    object::TORQUE_ACTUAL,
    object::FOLLOWING_ERROR,
    object::DIGITAL_INPUTS,
    object::VL_VELOCITY_DEMAND,
    object::VL_VELOCITY_ACTUAL,
    object::PROBE_STATUS,
    object::PROBE_1_POSITIVE,
    object::PROBE_1_NEGATIVE,
    object::PROBE_2_POSITIVE,
    object::PROBE_2_NEGATIVE,
];

/// Slots of these objects of an axis, as far as the dictionary has them, with their indices for the
/// first axis.
pub(super) type Slots = Vec<(Slot, u16)>;

pub(super) fn find_updated(objects: &Dictionary, axis: usize, is_drive: bool) -> Slots {
    let is_updated = |index| {
        let is_shared = index == object::ERROR_REGISTER;
        if axis == 0 { is_drive || is_shared } else { is_drive && !is_shared }
    };
    let find = |index| objects.find((axis_index(axis, index), 0)).ok().map(|slot| (slot, index));
    UPDATED_OBJECTS.into_iter().filter(|index| is_updated(*index)).filter_map(find).collect()
}

/// Most axes of a node.
pub(super) const MOST_AXES: usize = 8;

/// Objects of the first axis; those of the others follow at this distance.
const FIRST_OBJECTS: u16 = 0x6000;
const OBJECTS: u16 = 0x800;

/// Splits the index of an object of the profile into the axis and the index for the first axis; other
/// objects belong to the first axis.
pub(super) const fn split_index(index: u16) -> (usize, u16) {
    match index.checked_sub(FIRST_OBJECTS) {
        Some(offset) if (offset / OBJECTS) < MOST_AXES as u16 => {
            ((offset / OBJECTS) as usize, FIRST_OBJECTS + offset % OBJECTS)
        }
        _ => (0, index),
    }
}

/// Index of an object of an axis, by that of the first one.
pub(super) const fn axis_index(axis: usize, index: u16) -> u16 {
    if index >= FIRST_OBJECTS && index - FIRST_OBJECTS < OBJECTS {
        index + axis as u16 * OBJECTS
    } else {
        index
    }
}

/// The nearest integer, as `value.round() as i64`, which needs a call into a library on processors
/// without SSE 4.1.
pub(super) fn nearest(value: f64) -> i64 {
    let whole = value as i64;
    let rest = value - whole as f64;
    whole.saturating_add(i64::from(rest >= 0.5)).saturating_sub(i64::from(rest <= -0.5))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_of_an_axis_are_at_their_distance() {
        assert_eq!(axis_index(0, 0x6040), 0x6040);
        assert_eq!(axis_index(1, 0x6040), 0x6840);
        assert_eq!(axis_index(7, 0x67FF), 0x9FFF);
        assert_eq!(axis_index(3, 0x1017), 0x1017);
        assert_eq!(axis_index(1, 0x6800), 0x6800, "already of the second axis");
        for (index, expected) in [
            (0x6040, (0, 0x6040)),
            (0x6840, (1, 0x6040)),
            (0x9FFF, (7, 0x67FF)),
            (0xA000, (0, 0xA000)),
            (0x2000, (0, 0x2000)),
        ] {
            assert_eq!(split_index(index), expected);
        }
    }

    #[test]
    fn nearest_integer_is_that_of_round() {
        let edges = [0.0, 0.499_999_999_999_999_94, 0.5, 1.5, 2.5, 1e9 + 0.5, 4.5e15 + 0.5, 9.3e18];
        let special = [f64::NAN, f64::INFINITY, f64::MAX, f64::MIN_POSITIVE, 2f64.powi(63)];
        for value in edges.into_iter().chain(special) {
            for value in [value, -value, value.next_up(), value.next_down()] {
                assert_eq!(nearest(value), value.round() as i64, "{value:?}");
            }
        }
    }
}
