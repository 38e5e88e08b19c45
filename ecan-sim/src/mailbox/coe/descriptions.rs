//! Objects and entries as SDO information describes them (ETG.1000.6).

use ecan_protocol::mapping::locate_data_object;
use ecan_protocol::object::{AbortCode, Entry, Object, ObjectType, object};

use crate::gateway::Gateway;

use super::entry_rights::entry_rights;

mod code {
    pub(super) const VAR: u8 = 7;
    pub(super) const ARRAY: u8 = 8;
    pub(super) const RECORD: u8 = 9;
}

/// Value information, data type, bit length and access of an entry description.
const GAP_BYTES: usize = 7;

/// Data types of whole objects.
mod record {
    pub(super) const PDO_MAPPING: u16 = 0x0021;
    pub(super) const IDENTITY: u16 = 0x0023;
    pub(super) const RECORD: u16 = 0x002A;
}

/// Optional parts of an entry description. The units of the dictionary are texts, not the codes of
/// the standard, and are omitted.
mod value_info {
    pub(super) const DEFAULT: u8 = 0x10;
    pub(super) const MINIMUM: u8 = 0x20;
    pub(super) const MAXIMUM: u8 = 0x40;
}

fn type_code(ty: ObjectType) -> u16 {
    match ty {
        ObjectType::I32 => 0x0004,
        ObjectType::U8 => 0x0005,
        ObjectType::U16 => 0x0006,
        ObjectType::U32 => 0x0007,
        ObjectType::VisibleString | ObjectType::String16 => 0x0009,
    }
}

fn object_kind(index: u16, object: &Object) -> (u16, u8) {
    let entry_type = |subindex| object.entry(subindex).map_or(0, |entry| type_code(entry.ty));
    match index {
        0x1018 => (record::IDENTITY, code::RECORD),
        0x1600..=0x17FF | 0x1A00..=0x1BFF => (record::PDO_MAPPING, code::RECORD),
        0x1C00..=0x1C13 => (entry_type(1), code::ARRAY),
        _ => (record::RECORD, code::RECORD),
    }
}

/// The object, unless the firmware of the variant lacks it, and its highest subindex.
fn find_object(index: u16, gateway: &Gateway) -> Result<(&'static Object, u8), AbortCode> {
    let variant = &gateway.config().variant;
    let object = object(index).filter(|_| !variant.missing_entries.lacks_object(index));
    let object = object.ok_or(AbortCode::NO_OBJECT)?;
    let highest = match locate_data_object(index) {
        Some(_) => variant.mapped_subindex.number(),
        None => object.highest_subindex(),
    };
    Ok((object, highest))
}

pub(super) fn describe_object(index: u16, gateway: &Gateway) -> Result<Vec<u8>, AbortCode> {
    let (object, highest) = find_object(index, gateway)?;
    let (data_type, code) = match highest {
        0 => (gateway.find_entry(index, 0).map_or(0, |(_, entry)| type_code(entry.ty)), code::VAR),
        _ => object_kind(index, object),
    };
    let kind = [highest, code];
    let mut body =
        [&index.to_le_bytes()[..], &data_type.to_le_bytes(), &kind, object.name.as_bytes()]
            .concat();
    if let Some(instance) = object.instance(index).filter(|_| object.count > 1) {
        body.extend_from_slice(format!(" {instance}").as_bytes());
    }
    Ok(body)
}

/// Description of an entry, after the SDO information header, with the known values of `requested`.
pub(super) fn describe_entry(
    index: u16,
    subindex: u8,
    requested: u8,
    gateway: &Gateway,
) -> Result<Vec<u8>, AbortCode> {
    let (_, highest) = find_object(index, gateway)?;
    if subindex > highest {
        return Err(AbortCode::NO_SUBINDEX);
    }
    let Ok((_, entry)) = gateway.find_entry(index, subindex) else {
        // a gap: no type, no length, no access, no name
        let [i0, i1] = index.to_le_bytes();
        return Ok([&[i0, i1, subindex][..], &[0; GAP_BYTES]].concat());
    };
    let bytes = entry.ty.size_bytes().unwrap_or_else(|| gateway.text(index).len());
    let (contained, values) = known_values(entry, requested);
    Ok([
        &index.to_le_bytes()[..],
        &[subindex, contained],
        &type_code(entry.ty).to_le_bytes(),
        &((bytes * 8) as u16).to_le_bytes(),
        &entry_rights(index, entry).to_le_bytes(),
        &values,
        entry.name.as_bytes(),
    ]
    .concat())
}

/// Default, minimum and maximum, those requested and known, and which they are.
fn known_values(entry: &Entry, requested: u8) -> (u8, Vec<u8>) {
    let size = entry.ty.size_bytes().filter(|_| entry.ty.is_integer());
    let (min, max) = match entry.ty {
        // the dictionary has no limits for this signed type
        ObjectType::I32 if (entry.min, entry.max) == (0, u32::MAX) => {
            (i32::MIN as u32, i32::MAX as u32)
        }
        _ => (entry.min, entry.max),
    };
    let known = [
        (value_info::DEFAULT, entry.default),
        (value_info::MINIMUM, Some(min)),
        (value_info::MAXIMUM, Some(max)),
    ];
    let mut contained = 0;
    let mut values = Vec::new();
    for (bit, value) in known {
        if let (Some(value), Some(size)) = (value, size)
            && requested & bit != 0
        {
            contained |= bit;
            values.extend(value.to_le_bytes().into_iter().take(size));
        }
    }
    (contained, values)
}
