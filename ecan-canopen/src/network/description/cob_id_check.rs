//! Check of the COB-IDs of each bus: each has one sender.

use std::collections::BTreeMap;

use ecan_protocol::can::CanId;

use super::network_description::NetworkDescription;
use super::network_fault::{NetworkFault, NetworkFaultKind, PdoName};
use super::node_description::NodeDescription;
use crate::network::pdo_mapping::PdoDirection;
use crate::{CobId, PdoCobId, object};

/// Sender of a COB-ID: its node, and a text.
type Sender = (Option<usize>, String);

pub(super) fn check(network: &NetworkDescription, faults: &mut Vec<NetworkFault>) {
    for channel in &network.channels {
        let here = |node: &NodeDescription| {
            (node.address.slave, node.address.channel) == (channel.slave, channel.channel)
        };
        let nodes = || network.nodes.iter().enumerate().filter(|(_, node)| here(node));
        let mut senders = BTreeMap::new();
        let mut add = |id: CanId, sender: Sender| {
            let key = (id.is_extended(), id.raw());
            match senders.get(&key) {
                None => _ = senders.insert(key, sender),
                Some((first_node, first)) if *first_node != sender.0 || *first != sender.1 => {
                    let nodes = first_node.iter().copied().chain(sender.0).collect();
                    let (first, second): (&String, _) = (first, sender.1);
                    let kind = NetworkFaultKind::Collision { id, first: first.clone(), second };
                    faults.push(NetworkFault { nodes, kind });
                }
                Some(_) => {}
            }
        };
        for (id, text) in [(CobId::NMT, "NMT"), (CobId::SYNC, "SYNC"), (CobId::TIME, "TIME")] {
            add(id.can_id(), (None, text.to_owned()));
        }
        if let Some(host) = network.host_heartbeat {
            add(CobId::heartbeat(host.node).can_id(), (None, "the host's heartbeat".to_owned()));
        }
        for (nth, node) in nodes() {
            for (id, what) in services(node) {
                add(id, (Some(nth), format!("{what} of {}", node.title())));
            }
        }
        for (nth, node) in nodes() {
            for (pdo, id) in
                valid_pdos(node).filter(|(pdo, _)| pdo.direction == PdoDirection::Transmit)
            {
                add(id, (Some(nth), format!("{pdo} of {}", node.title())));
            }
        }
    }
}

/// COB-IDs of the services of a node, except PDOs.
fn services(node: &NodeDescription) -> Vec<(CanId, &'static str)> {
    let id = node.address.node;
    let emcy = number(node, object::EMCY_COB_ID, 0).and_then(PdoCobId::from_raw);
    let emcy = match emcy {
        Some(emcy) => emcy.is_valid.then_some(emcy.id),
        None => Some(CobId::emcy(id).can_id()),
    };
    let mut services = vec![
        (CobId::sdo_client(id).can_id(), "SDO requests"),
        (CobId::sdo_server(id).can_id(), "SDO responses"),
        (CobId::heartbeat(id).can_id(), "heartbeat"),
    ];
    services.extend(emcy.map(|id| (id, "EMCY")));
    services
}

/// PDOs of a node that exist after its boot-up: those that are described, and those that exist by
/// its device file.
fn valid_pdos(node: &NodeDescription) -> impl Iterator<Item = (PdoName, CanId)> + '_ {
    let described = node.pdos.iter().map(|pdo| {
        let PdoName { direction, number } =
            PdoName { direction: pdo.direction, number: pdo.number };
        (PdoName { direction, number }, pdo.cob_id)
    });
    let name = |index: u16| match index {
        0x1400..=0x15FF => {
            Some(PdoName { direction: PdoDirection::Receive, number: index - 0x1400 + 1 })
        }
        0x1800..=0x19FF => {
            Some(PdoName { direction: PdoDirection::Transmit, number: index - 0x1800 + 1 })
        }
        _ => None,
    };
    let is_described = |pdo: &PdoName| {
        node.pdos.iter().any(|it| (it.direction, it.number) == (pdo.direction, pdo.number))
            || node.disabled_pdos.contains(&(pdo.direction, pdo.number))
    };
    let objects = node.device.iter().flat_map(|device| device.objects());
    let by_file = objects.filter_map(move |object| {
        let pdo = name(object.index).filter(|pdo| !is_described(pdo))?;
        let cob_id = PdoCobId::from_raw(number(node, object.index, 1)?)?;
        cob_id.is_valid.then_some((pdo, cob_id.id))
    });
    described.chain(by_file)
}

/// Value of an object after the boot-up, as far as override and device file state it.
fn number(node: &NodeDescription, index: u16, subindex: u8) -> Option<u32> {
    if let Some(value) =
        node.overrides.iter().find(|it| (it.index, it.subindex) == (index, subindex))
    {
        let bytes = value.data.first_chunk::<4>()?;
        return Some(u32::from_le_bytes(*bytes));
    }
    let entry = node.device.as_ref()?.entry(index, subindex)?;
    let value = entry.configured_value(node.address.node)?.to_integer()?;
    u32::try_from(value).ok()
}
