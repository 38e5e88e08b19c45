//! CAN application protocol over EtherCAT (ETG.1000.6): its services, emergencies, and SDO information, which
//! describes the object dictionary with the access rights of each entry.

use ecan_protocol::mapping::locate_data_object;
use ecan_protocol::object::{AbortCode, Access, Entry, Object, ObjectType, object, objects};

use super::messages::{COE_HEADER_BYTES, Context, MailboxError, coe_message, service};
use super::sdo_server::SdoServer;
use crate::gateway::variant::{GatewayVariant, SdoInformation};
use crate::gateway::{Emergency, Gateway, find_entry};

pub(super) fn emergency_message(emergency: Emergency) -> Vec<u8> {
    coe_message(service::EMERGENCY, &[&emergency.message()])
}

pub(super) fn request(
    sdo: &mut SdoServer,
    body: &[u8],
    context: &mut Context<'_>,
) -> Result<Vec<Vec<u8>>, MailboxError> {
    let (&[_, high], rest) =
        body.split_first_chunk::<COE_HEADER_BYTES>().ok_or(MailboxError::SizeTooShort)?;
    match high >> 4 {
        service::SDO_REQUEST => Ok(sdo.request(rest, context)?.into_iter().collect()),
        service::SDO_INFORMATION => answer(rest, context),
        // services that only a slave sends, and process data outside the sync managers
        service::EMERGENCY
        | service::SDO_RESPONSE
        | service::TX_PDO..=service::RX_PDO_REMOTE_REQUEST => {
            Err(MailboxError::ServiceNotSupported)
        }
        _ => Err(MailboxError::InvalidHeader),
    }
}

const INFO_HEADER_BYTES: usize = 4;

/// Services in the SDO information header.
mod opcode {
    pub(super) const LIST_REQUEST: u8 = 1;
    pub(super) const LIST: u8 = 2;
    pub(super) const OBJECT_REQUEST: u8 = 3;
    pub(super) const OBJECT: u8 = 4;
    pub(super) const ENTRY_REQUEST: u8 = 5;
    pub(super) const ENTRY: u8 = 6;
    pub(super) const ERROR: u8 = 7;
    /// More fragments follow.
    pub(super) const INCOMPLETE: u8 = 0x80;
}

fn answer(request: &[u8], context: &Context<'_>) -> Result<Vec<Vec<u8>>, MailboxError> {
    if context.gateway.config().variant.sdo_information == SdoInformation::Absent {
        return Err(MailboxError::ServiceNotSupported);
    }
    let (&[service, ..], body) =
        request.split_first_chunk::<INFO_HEADER_BYTES>().ok_or(MailboxError::SizeTooShort)?;
    let (opcode, result) = match service & !opcode::INCOMPLETE {
        opcode::LIST_REQUEST => {
            let &[t0, t1] = parameters(body)?;
            (opcode::LIST, list(u16::from_le_bytes([t0, t1]), context.gateway))
        }
        opcode::OBJECT_REQUEST => {
            let &[i0, i1] = parameters(body)?;
            (opcode::OBJECT, describe_object(u16::from_le_bytes([i0, i1]), context.gateway))
        }
        opcode::ENTRY_REQUEST => {
            let &[i0, i1, subindex, requested] = parameters(body)?;
            let index = u16::from_le_bytes([i0, i1]);
            (opcode::ENTRY, describe_entry(index, subindex, requested, context.gateway))
        }
        _ => (opcode::ERROR, Err(AbortCode::COMMAND)),
    };
    Ok(match result {
        Ok(body) => fragments(opcode, &body, context.room),
        Err(code) => fragments(opcode::ERROR, &code.0.to_le_bytes(), context.room),
    })
}

fn parameters<const N: usize>(body: &[u8]) -> Result<&[u8; N], MailboxError> {
    body.first_chunk().ok_or(MailboxError::SizeTooShort)
}

/// An object list: its type, then its indices or the lengths.
fn list(list_type: u16, gateway: &Gateway) -> Result<Vec<u8>, AbortCode> {
    let list = object_list(list_type, &gateway.config().variant)?;
    Ok(std::iter::once(list_type).chain(list).flat_map(u16::to_le_bytes).collect())
}

/// Divides a response into fragments; none ends within an index of a list.
fn fragments(opcode: u8, body: &[u8], room: usize) -> Vec<Vec<u8>> {
    let bytes = room.saturating_sub(COE_HEADER_BYTES + INFO_HEADER_BYTES) & !1;
    let parts = body.chunks(bytes.max(2));
    let count = parts.len();
    parts
        .enumerate()
        .map(|(number, part)| {
            let left = count - 1 - number;
            let more = if left > 0 { opcode::INCOMPLETE } else { 0 };
            let header = [opcode | more, 0];
            coe_message(service::SDO_INFORMATION, &[&header, &(left as u16).to_le_bytes(), part])
        })
        .collect()
}

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
        0 => (
            find_entry(&gateway.config().variant, index, 0)
                .map_or(0, |(_, entry)| type_code(entry.ty)),
            code::VAR,
        ),
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
    let Ok((_, entry)) = find_entry(&gateway.config().variant, index, subindex) else {
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

pub(super) mod rights {
    /// Readable in PREOP, SAFEOP and OP.
    pub(super) const READ: u16 = 0x0007;
    pub(super) const WRITE_PREOP: u16 = 0x0008;
    pub(super) const WRITE_SAFEOP: u16 = 0x0010;
    /// Writable in PREOP, SAFEOP and OP.
    pub(super) const WRITE: u16 = 0x0038;
    pub(super) const RX_MAPPABLE: u16 = 0x0040;
    pub(super) const TX_MAPPABLE: u16 = 0x0080;
    pub(super) const BACKUP: u16 = 0x0100;
    /// A startup parameter.
    pub(super) const SETTING: u16 = 0x0200;
}

pub(super) fn entry_rights(index: u16, entry: &Entry) -> u16 {
    let mut field = 0;
    if entry.access.can_read() {
        field |= rights::READ;
    }
    if entry.access.can_write() {
        field |= match index {
            // assignments are writable in PREOP and SAFEOP
            0x1C12 | 0x1C13 => rights::WRITE_PREOP | rights::WRITE_SAFEOP,
            // the sync manager owns the memory while process data is exchanged
            0x7000..=0x7FFF => rights::WRITE_PREOP,
            _ => rights::WRITE,
        };
    }
    if entry.subindex == ecan_protocol::object::MAPPED_SUBINDEX {
        field |= match index {
            0x6000..=0x6FFF => rights::TX_MAPPABLE,
            0x7000..=0x7FFF => rights::RX_MAPPABLE,
            _ => 0,
        };
    }
    match index {
        0x1C12 | 0x1C13 => field |= rights::SETTING,
        _ if is_saved(index) && entry.access == Access::Rw && !is_command(entry) => {
            field |= rights::BACKUP | rights::SETTING;
        }
        _ => {}
    }
    field
}

pub(super) fn object_rights(index: u16, object: &Object) -> u16 {
    object.entries.iter().fold(0, |field, entry| field | entry_rights(index, entry))
}

fn is_saved(index: u16) -> bool {
    object(index).is_some_and(|object| object.is_saved)
}

fn is_command(entry: &Entry) -> bool {
    entry.name.ends_with("ommand") || entry.meaning(0) == Some("no-op")
}

/// List type of the lengths of the others.
const LENGTHS: u16 = 0;
/// List types, from 1 on, by the property of their objects; the first has all objects.
const MEMBERSHIP: [Option<u16>; 5] = [
    None,
    Some(rights::RX_MAPPABLE),
    Some(rights::TX_MAPPABLE),
    Some(rights::BACKUP),
    Some(rights::SETTING),
];

pub(super) fn all_objects() -> impl Iterator<Item = (u16, &'static Object)> {
    objects().iter().flat_map(|object| object.indices().map(move |index| (index, *object)))
}

fn members(membership: Option<u16>, variant: &GatewayVariant) -> impl Iterator<Item = u16> {
    let missing = &variant.missing_entries;
    let objects = all_objects().filter(|(index, _)| !missing.lacks_object(*index));
    objects.filter_map(move |(index, object)| {
        membership.is_none_or(|field| object_rights(index, object) & field != 0).then_some(index)
    })
}

pub(super) fn object_list(list_type: u16, variant: &GatewayVariant) -> Result<Vec<u16>, AbortCode> {
    if list_type == LENGTHS {
        let length = |membership: &Option<u16>| members(*membership, variant).count() as u16;
        return Ok(MEMBERSHIP.iter().map(length).collect());
    }
    let membership =
        MEMBERSHIP.get(usize::from(list_type) - 1).ok_or(AbortCode::UNSUPPORTED_ACCESS)?;
    Ok(members(*membership, variant).collect())
}
