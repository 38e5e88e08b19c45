//! From a node of a file to its description: device file, names, values.

use std::path::PathBuf;
use std::sync::Arc;

use ecan_canopen::{
    BootConfig, CobId, DeviceFile, IdentityCheck, MappingEntry, NodeAddress, NodeDescription,
    NodeId, ObjectEntry, Parameter, PdoCobId, PdoDirection, PdoMapping, RevisionCheck,
    TransmissionType, object,
};
use ecan_protocol::can::CanId;
use ecan_protocol::text::Printable;

use super::source::{NodeSettings, NodeSource, ParameterSource, PdoSource, RevisionRule};
use crate::config_file::fault::Located;

/// Receives a fault with its location.
pub(crate) type Report<'a> = dyn FnMut(usize, String) + 'a;

/// A node with the locations of its parts, for faults of the network.
pub(crate) struct ResolvedNode {
    pub(crate) description: NodeDescription,
    pub(crate) at: usize,
    /// Of each override.
    pub(crate) parameters: Vec<usize>,
    /// Of each PDO.
    pub(crate) pdos: Vec<usize>,
    /// What its device file makes different from the usual boot-up.
    pub(crate) notes: Vec<String>,
    /// Path of its device file in the configuration.
    pub(crate) device_file: Option<PathBuf>,
}

/// The description of a node; `None` without a node-ID. Faults of names and values are reported.
pub(crate) fn resolve(
    source: &NodeSource,
    device: Option<Arc<DeviceFile>>,
    report: &mut Report<'_>,
) -> Option<ResolvedNode> {
    let by_file = || device.as_ref()?.commissioning.as_ref()?.node_id;
    let Some(node) = source.node.as_ref().map(|node| node.value).or_else(by_file) else {
        report(source.at, "`node` is missing: the node-ID, 1 to 127".to_owned());
        return None;
    };
    let address = NodeAddress { slave: source.slave, channel: source.channel, node };
    let file = device.as_deref();
    if let Some(fault) = source.settings.guarding_fault() {
        report(source.settings.guard_time_at, fault.to_owned());
    }
    let mut notes = source.notes.clone();
    if let Some((summary, path)) =
        file.and_then(DeviceFile::warning_summary).zip(source.device_file.as_ref())
    {
        notes.push(format!("{}: {summary}", Printable(path.value.display())));
    }
    let identity = identity(&source.settings, file, node, &mut notes);
    let mut boot = source.settings.boot_config(&source.name, identity);
    choose_life_sign(&source.settings, file, &mut boot, &mut notes);
    let mut description =
        NodeDescription { name: source.name.clone(), boot, ..NodeDescription::new(address) };
    let (mut parameters, mut pdos) = (Vec::new(), Vec::new());
    for parameter in &source.parameters {
        if let Some(value) = parameter_value(parameter, file, report) {
            description.overrides.push(value);
            parameters.push(parameter.value.at);
        }
    }
    for pdo in &source.pdos {
        if !pdo.is_enabled {
            description.disabled_pdos.push((pdo.direction, pdo.number));
        } else if let Some(mapping) = mapping(pdo, file, node, report) {
            description.pdos.push(mapping);
            pdos.push(pdo.at);
        }
    }
    description.device = device;
    let at = source.node.as_ref().map_or(source.at, |node| node.at);
    let device_file = source.device_file.as_ref().map(|path| path.value.clone());
    Some(ResolvedNode { description, at, parameters, pdos, notes, device_file })
}

/// A node whose file has no heartbeat producer that can be set is guarded, or not watched, unless its settings state
/// something else.
fn choose_life_sign(
    settings: &NodeSettings,
    file: Option<&DeviceFile>,
    boot: &mut BootConfig,
    notes: &mut Vec<String>,
) {
    let Some(file) = file.filter(|_| settings.heartbeat_ms.is_none() && boot.guarding.is_none())
    else {
        return;
    };
    let is_writable = |index| file.entry(index, 0).is_some_and(|entry| entry.access.is_writable());
    if is_writable(object::PRODUCER_HEARTBEAT) {
        return;
    }
    let instead = if is_writable(object::GUARD_TIME)
        && is_writable(object::LIFE_TIME_FACTOR)
        && file.object(object::PRODUCER_HEARTBEAT).is_none()
    {
        let guarding = NodeSettings::guarding_every(boot.heartbeat_ms, settings.life_time_factor);
        boot.guarding = Some(guarding);
        format!("it is guarded every {} ms", guarding.guard_time.as_millis())
    } else {
        "the host does not watch it".to_owned()
    };
    boot.heartbeat_ms = 0;
    notes.push(format!("the device file has no writable object 0x1017 (heartbeat): {instead}"));
}

/// The identity of the device file, unless the node has another one. Vendor and product are compared if `DeviceInfo`
/// and 0x1018 state the same: makers leave out or contradict either.
fn identity(
    settings: &NodeSettings,
    file: Option<&DeviceFile>,
    node: NodeId,
    notes: &mut Vec<String>,
) -> IdentityCheck {
    let checks = settings.checks_identity.unwrap_or(true);
    let info = file.filter(|_| checks).map(|file| &file.device_info);
    let number = |index, subindex| {
        let value = file?.entry(index, subindex)?.configured_value(node)?.to_integer()?;
        u32::try_from(value).ok().filter(|value| *value != 0)
    };
    let mut by_file = |name: &str, stated: Option<u32>, subindex, is_wanted: bool| {
        let own = number(object::IDENTITY, subindex);
        let stated = stated.filter(|value| *value != 0);
        if let (Some(stated), Some(own), true) = (stated, own, checks && stated != own) {
            notes.push(format!(
                "{name} is not compared: the device file states 0x{stated:X} in [DeviceInfo] and 0x{own:X} in \
                 0x1018:{subindex:02X}"
            ));
            return None;
        }
        let both = own.filter(|own| stated == Some(*own));
        if is_wanted { own.or(stated) } else { both }
    };
    let checked = |value: Option<u32>| value.filter(|_| checks);
    let vendor = by_file("the vendor-ID", info.and_then(|info| info.vendor_number), 1, false);
    let product = by_file("the product code", info.and_then(|info| info.product_number), 2, false);
    let revision = by_file("the revision", info.and_then(|info| info.revision_number), 3, true);
    let revision = settings.revision_number.or(revision);
    IdentityCheck {
        device_type: settings.device_type.or_else(|| checked(number(object::DEVICE_TYPE, 0))),
        vendor_id: settings.vendor_id.or_else(|| checked(vendor)),
        product_code: settings.product_code.or_else(|| checked(product)),
        revision: match (settings.revision.unwrap_or_default(), revision) {
            (RevisionRule::Exact, Some(revision)) => RevisionCheck::Exactly(revision),
            (RevisionRule::Compatible, Some(revision)) => RevisionCheck::Compatible(revision),
            _ => RevisionCheck::Any,
        },
        serial_number: settings.serial_number,
    }
}

fn parameter_value(
    parameter: &ParameterSource,
    file: Option<&DeviceFile>,
    report: &mut Report<'_>,
) -> Option<Parameter> {
    let ParameterSource { object, value } = parameter;
    let entry = match entry(object, file) {
        Ok(entry) => entry,
        Err(reason) => {
            report(object.at, reason);
            return None;
        }
    };
    let encoded =
        entry.data_type.parse(&value.value).and_then(|value| entry.data_type.encode(&value));
    match (encoded, file) {
        (Ok(data), Some(file)) => Some(Parameter {
            name: file.label(entry).into(),
            is_verified: entry.access.is_readable(),
            ..Parameter::new((entry.index, entry.subindex), data)
        }),
        (Ok(_), None) => None,
        (Err(error), _) => {
            report(value.at, format!("`{}`: {error}", object.value));
            None
        }
    }
}

fn entry<'f>(
    object: &Located<String>,
    file: Option<&'f DeviceFile>,
) -> Result<&'f ObjectEntry, String> {
    let file = file.ok_or_else(|| {
        format!("`{}`: the type of the object is not known; set `device_file`", object.value)
    })?;
    file.find(&object.value).map_err(|error| error.to_string())
}

fn mapping(
    pdo: &PdoSource,
    file: Option<&DeviceFile>,
    node: NodeId,
    report: &mut Report<'_>,
) -> Option<PdoMapping> {
    let cob_id = cob_id(pdo, file, node, report)?;
    let transmission = match &pdo.transmission {
        Some(raw) => {
            let transmission = TransmissionType::from_raw(raw.value);
            if transmission.is_none() {
                let text = "transmission type is reserved; allowed: 0 to 240, 252 to 255";
                report(raw.at, text.to_owned());
            }
            transmission?
        }
        None => communication(pdo, file, node, 2)
            .and_then(|raw| TransmissionType::from_raw(u8::try_from(raw).ok()?))
            .unwrap_or(TransmissionType::Synchronous(1)),
    };
    let entries = match &pdo.objects {
        Some(objects) => objects
            .iter()
            .filter_map(|object| match mapping_entry(object, file) {
                Ok(entry) => Some(entry),
                Err(reason) => {
                    report(object.at, reason);
                    None
                }
            })
            .collect(),
        None => default_entries(pdo, file, node),
    };
    Some(PdoMapping {
        direction: pdo.direction,
        number: pdo.number,
        cob_id,
        transmission,
        inhibit_time: pdo.inhibit_time,
        event_timer_ms: pdo.event_timer_ms,
        sync_start: pdo.sync_start,
        entries,
    })
}

/// The COB-ID of the file, of the device file, or of the predefined connection set.
fn cob_id(
    pdo: &PdoSource,
    file: Option<&DeviceFile>,
    node: NodeId,
    report: &mut Report<'_>,
) -> Option<CanId> {
    if let Some(raw) = &pdo.cob_id {
        return CanId::standard(raw.value).ok();
    }
    let by_file = || PdoCobId::from_raw(communication(pdo, file, node, 1)?).map(|cob_id| cob_id.id);
    let by_file = by_file().filter(|id| !pdo.is_predefined && id.raw() != 0);
    let predefined = || {
        let number = u8::try_from(pdo.number).ok().filter(|number| (1..=4).contains(number))?;
        let id = match pdo.direction {
            PdoDirection::Receive => CobId::rpdo(node, number),
            PdoDirection::Transmit => CobId::tpdo(node, number),
        };
        Some(id.can_id())
    };
    let id = by_file.or_else(predefined);
    if id.is_none() {
        let reason = "has no COB-ID in the predefined connection set; set `cob_id`";
        report(pdo.at, format!("PDO {} {reason}", pdo.number));
    }
    id
}

/// Communication parameter of a PDO in the device file.
fn communication(
    pdo: &PdoSource,
    file: Option<&DeviceFile>,
    node: NodeId,
    subindex: u8,
) -> Option<u32> {
    let base = match pdo.direction {
        PdoDirection::Receive => object::RPDO_COMMUNICATION,
        PdoDirection::Transmit => object::TPDO_COMMUNICATION,
    };
    let index = base.wrapping_add(pdo.number.wrapping_sub(1));
    let value = file?.entry(index, subindex)?.configured_value(node)?.to_integer()?;
    u32::try_from(value).ok()
}

fn mapping_entry(
    object: &Located<String>,
    file: Option<&DeviceFile>,
) -> Result<MappingEntry, String> {
    let entry = entry(object, file)?;
    let bits = entry.data_type.pdo_bits().ok_or_else(|| {
        format!("`{}` is {}; a PDO cannot contain it", object.value, entry.data_type)
    })?;
    Ok(MappingEntry::new(entry.index, entry.subindex, bits))
}

/// The mapping of the device file.
fn default_entries(pdo: &PdoSource, file: Option<&DeviceFile>, node: NodeId) -> Vec<MappingEntry> {
    let base = match pdo.direction {
        PdoDirection::Receive => object::RPDO_MAPPING,
        PdoDirection::Transmit => object::TPDO_MAPPING,
    };
    let index = base.wrapping_add(pdo.number.wrapping_sub(1));
    let number = |subindex| {
        let value = file?.entry(index, subindex)?.configured_value(node)?.to_integer()?;
        u32::try_from(value).ok()
    };
    let count = number(0).and_then(|count| u8::try_from(count).ok()).unwrap_or(0);
    (1..=count.min(64)).filter_map(number).map(MappingEntry::from_raw).collect()
}
