//! Check of the PDOs of a node against its device file.

use super::network_fault::{NetworkFaultKind, PdoName};
use super::node_description::NodeDescription;
use crate::MappingEntry;
use crate::device_file::DeviceFile;
use crate::network::boot::Subject;
use crate::network::pdo_mapping::{PdoDirection, PdoMapping};

pub(super) fn check(node: &NodeDescription, report: &mut impl FnMut(NetworkFaultKind)) {
    for (nth, pdo) in node.pdos.iter().enumerate() {
        let name = PdoName { direction: pdo.direction, number: pdo.number };
        let same =
            |other: &PdoMapping| (other.direction, other.number) == (pdo.direction, pdo.number);
        if node.pdos.iter().take(nth).any(same) {
            report(NetworkFaultKind::DuplicatePdo { pdo: name });
        }
        if let Err(error) = pdo.steps() {
            report(NetworkFaultKind::Pdo { pdo: name, error });
        }
        if is_reserved(pdo.cob_id.raw()) && !pdo.cob_id.is_extended() {
            report(NetworkFaultKind::Reserved { pdo: name, id: pdo.cob_id });
        }
        let Some(device) = node.device.as_deref() else { continue };
        let index = pdo.communication_index();
        if device.object(index).is_none() {
            report(NetworkFaultKind::NoPdo { pdo: name, index });
        }
        for entry in &pdo.entries {
            check_entry(device, name, *entry, report);
        }
    }
}

fn check_entry(
    device: &DeviceFile,
    pdo: PdoName,
    entry: MappingEntry,
    report: &mut impl FnMut(NetworkFaultKind),
) {
    if is_dummy(device, pdo.direction, entry) {
        return;
    }
    let Some(object) = device.entry(entry.index, entry.subindex) else {
        return report(NetworkFaultKind::NoObject { pdo, entry });
    };
    let subject = Subject {
        index: entry.index,
        subindex: entry.subindex,
        name: Some(device.label(object).into()),
    };
    let is_mappable = match pdo.direction {
        PdoDirection::Receive => object.is_rpdo_mappable(),
        PdoDirection::Transmit => object.is_tpdo_mappable(),
    };
    match object.data_type.pdo_bits() {
        _ if !is_mappable => report(NetworkFaultKind::NotMappable { pdo, subject }),
        Some(expected) if expected != entry.bits => {
            report(NetworkFaultKind::EntryLength { pdo, subject, expected, found: entry.bits });
        }
        _ => {}
    }
}

/// A data type as a gap in an RPDO (CiA 301, 7.4.7.1).
fn is_dummy(device: &DeviceFile, direction: PdoDirection, entry: MappingEntry) -> bool {
    direction == PdoDirection::Receive && device.dummy_usage.contains(&entry.index)
}

/// CAN-IDs that a PDO must not have (CiA 301, 7.3.5).
fn is_reserved(raw: u32) -> bool {
    matches!(
        raw,
        0x000..=0x07F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF | 0x701..=0x7FF
    )
}
