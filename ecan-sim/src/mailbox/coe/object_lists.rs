//! Object lists of SDO information (ETG.1000.6).

use ecan_protocol::object::{AbortCode, Object, objects};

use crate::gateway::variant::GatewayVariant;

use super::entry_rights::{object_rights, rights};

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
