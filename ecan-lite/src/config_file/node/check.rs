//! Check of all nodes of a file together.

use ecan_canopen::{
    ChannelDescription, NetworkDescription, NetworkFault, NetworkFaultKind, NodeAddress,
    NodeDescription, Parameter, PdoMapping, PdoName, Subject,
};
use ecan_cia402::{AxisConfig, Cia402Config};
use ecan_mcan_port::Config;

use super::FileNode;
use super::resolve::ResolvedNode;
use crate::config_file::axis::FileAxis;
use crate::config_file::document::Document;
use crate::config_file::network::NetworkSettings;

/// The network of a file: the nodes, with the process data of the axes of theirs.
pub(crate) fn network(
    config: &Config,
    settings: &NetworkSettings,
    nodes: &[FileNode],
    axes: &[Option<FileAxis>],
) -> NetworkDescription {
    let Cia402Config { network, sync, .. } = &settings.cia402;
    let mut descriptions: Vec<_> = nodes.iter().map(|node| node.node.description.clone()).collect();
    let cycle_ns = config.adapter.cycle_ns();
    for FileAxis { config: axis, .. } in axes.iter().flatten() {
        let nth = descriptions.iter().position(|node| node.address == axis.address);
        let nth = nth.unwrap_or_else(|| {
            descriptions.push(NodeDescription::new(axis.address));
            descriptions.len() - 1
        });
        if let Some(node) = descriptions.get_mut(nth) {
            let of_node = axes.iter().flatten().map(|axis| &axis.config);
            let of_node: Vec<_> = of_node.filter(|other| other.address == axis.address).collect();
            // An invalid PDO is a fault of the axes.
            node.setup = Some(settings.cia402.setup_steps(&of_node, cycle_ns).unwrap_or_default());
            node.pdos.extend(axis.pdo_mappings());
        }
    }
    let channels = config.port.gateways.iter().enumerate().flat_map(|(slave, gateway)| {
        let channels = gateway.channels.into_iter().zip(0..);
        channels.filter_map(move |(channel, number)| {
            channel.map(|config| ChannelDescription { slave, channel: number, can: config.can })
        })
    });
    NetworkDescription {
        nodes: descriptions,
        channels: channels.collect(),
        host_heartbeat: network.host_heartbeat,
        sync: Some(*sync),
        cycle_ns,
    }
}

/// Checks the nodes and reports their faults to the document.
pub(crate) fn check(
    document: &Document<'_>,
    config: &Config,
    settings: &NetworkSettings,
    nodes: &[FileNode],
    axes: &[Option<FileAxis>],
) {
    if nodes.is_empty() {
        return;
    }
    for NetworkFault { nodes: concerned, kind } in network(config, settings, nodes, axes).check() {
        // Of several nodes, the fault is at the last one.
        let Some(node) = concerned.last().and_then(|nth| nodes.get(*nth)) else {
            document.semantic_fault(&[channel_path(&kind)], kind.to_string());
            continue;
        };
        if is_of_axes(&kind, &node.node.description, axes) {
            continue;
        }
        let text = match concerned.len() {
            1 => format!("{}: {kind}{}", node.node.description.title(), cure(&kind)),
            _ => kind.to_string(),
        };
        let at = location(node, &kind);
        let (at, text) = match &node.bus {
            Some(bus) => bus.fault(at, &text),
            None => (at, text),
        };
        document.push(at, text);
    }
}

/// The key that cures a step which the device file excludes.
fn cure(kind: &NetworkFaultKind) -> String {
    let NetworkFaultKind::Step { purpose, fault } = kind else { return String::new() };
    let keys = match *purpose {
        "heartbeat" => "set `heartbeat_ms` = 0, or `guard_time_ms`",
        "guard time" | "life time factor" => "leave out `guard_time_ms`",
        "device type" => "leave out `device_type`",
        "vendor-ID" => "leave out `vendor_id`",
        "product code" => "leave out `product_code`",
        "major revision" | "revision number" => "leave out `revision`",
        "serial number" => "leave out `serial_number`",
        "software identification" => "leave out `software`",
        "default parameters" => "leave out `restore`",
        "configuration date" => "leave out `configuration_date`",
        "save" => "leave out `save`",
        "transmission type" => "change `transmission`",
        "inhibit time" => "leave out `inhibit_time_100us`",
        "event timer" => "leave out `event_timer_ms`",
        "SYNC start value" => "leave out `sync_start`",
        "largest torque" => "leave out `max_torque`",
        "largest motor speed" => "leave out `max_motor_speed`",
        "torque slope" => "leave out `torque_slope`",
        "digital output mask" => "leave out `output_mask`",
        "buffer size" => "leave out `interpolation_buffer`",
        _ if matches!(**fault, NetworkFaultKind::Fixed { .. }) => "configure what the device has",
        _ => "compare the device file with the device",
    };
    format!("; {keys}")
}

/// Returns whether a fault is one between axes, which their check reports.
fn is_of_axes(kind: &NetworkFaultKind, node: &NodeDescription, axes: &[Option<FileAxis>]) -> bool {
    match kind {
        NetworkFaultKind::DuplicatePdo { pdo } => {
            let is_same =
                |other: &PdoMapping| (other.direction, other.number) == (pdo.direction, pdo.number);
            !node.pdos.iter().any(is_same)
        }
        NetworkFaultKind::Collision { id, .. } => {
            let channel = |address: NodeAddress| (address.slave, address.channel);
            let sends = |axis: &AxisConfig| {
                channel(axis.address) == channel(node.address)
                    && (0..axis.layout().tpdo_count()).any(|nth| axis.tpdo_id(nth) == *id)
            };
            axes.iter().flatten().filter(|axis| sends(&axis.config)).count() > 1
        }
        _ => false,
    }
}

/// Path of the channel of a fault without nodes.
fn channel_path(kind: &NetworkFaultKind) -> String {
    match kind {
        NetworkFaultKind::Load { slave, channel, .. } => format!("gateway[{slave}].can{channel}"),
        _ => String::new(),
    }
}

/// The part of a node that a fault comes from.
fn location(node: &FileNode, kind: &NetworkFaultKind) -> usize {
    let ResolvedNode { description, at, parameters, pdos, .. } = &node.node;
    let of_pdo = |pdo: &PdoName| {
        let is_same =
            |other: &PdoMapping| (other.direction, other.number) == (pdo.direction, pdo.number);
        description.pdos.iter().rposition(is_same).and_then(|nth| pdos.get(nth))
    };
    let of_value = |subject: &Subject| {
        let is_same =
            |other: &Parameter| (other.index, other.subindex) == (subject.index, subject.subindex);
        description.overrides.iter().position(is_same).and_then(|nth| parameters.get(nth))
    };
    let part = match kind {
        NetworkFaultKind::Pdo { pdo, .. }
        | NetworkFaultKind::DuplicatePdo { pdo }
        | NetworkFaultKind::NoPdo { pdo, .. }
        | NetworkFaultKind::NoObject { pdo, .. }
        | NetworkFaultKind::NotMappable { pdo, .. }
        | NetworkFaultKind::EntryLength { pdo, .. }
        | NetworkFaultKind::Reserved { pdo, .. } => of_pdo(pdo),
        NetworkFaultKind::NoParameter { subject }
        | NetworkFaultKind::ReadOnly { subject }
        | NetworkFaultKind::ValueLength { subject, .. }
        | NetworkFaultKind::Limit { subject, .. } => of_value(subject),
        _ => None,
    };
    part.copied().unwrap_or(*at)
}
