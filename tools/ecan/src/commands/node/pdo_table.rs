//! The PDOs of a node as its object dictionary describes them (CiA 301, 7.5.2.35 to 7.5.2.38).

use std::io::{self, Write};

use ecan_canopen::{MappingEntry, PdoCobId, PdoDirection, TransmissionType, object};
use ecan_protocol::can::CanId;
use serde::Serialize;

use crate::context::Result;
use crate::table;

use super::node_client::NodeClient;
use super::object_names::{ObjectNames, number};

/// PDOs that are asked for also after missing ones.
const USUAL: u16 = 4;
/// Most PDOs of a direction.
const MOST: u16 = 64;
/// Most entries of a mapping.
const ENTRIES: u64 = 64;

#[derive(Clone, Debug, Serialize)]
pub struct MappedObject {
    pub index: u16,
    pub subindex: u8,
    pub bits: u8,
    pub name: String,
}

/// A PDO of a node.
#[derive(Clone, Debug, Serialize)]
pub struct NodePdo {
    /// `RPDO` is received by the node, `TPDO` sent by it.
    pub kind: &'static str,
    pub number: u16,
    pub can_id: u32,
    pub is_extended: bool,
    pub is_valid: bool,
    pub transmission: Option<u8>,
    pub inhibit_us: Option<u64>,
    pub event_timer_ms: Option<u64>,
    pub mapping: Vec<MappedObject>,
}

impl NodePdo {
    pub fn name(&self) -> String {
        format!("{} {}", self.kind, self.number)
    }

    pub fn is_sent_with(&self, id: CanId) -> bool {
        self.is_valid && (id.raw(), id.is_extended()) == (self.can_id, self.is_extended)
    }

    pub fn bits(&self) -> u32 {
        self.mapping.iter().map(|it| u32::from(it.bits)).sum()
    }

    fn transmission_text(&self) -> String {
        let Some(raw) = self.transmission else { return "-".to_owned() };
        let text = match TransmissionType::from_raw(raw) {
            Some(TransmissionType::SynchronousAcyclic) => "SYNC, after an event".to_owned(),
            Some(TransmissionType::Synchronous(1)) => "every SYNC".to_owned(),
            Some(TransmissionType::Synchronous(every)) => format!("every {every} SYNCs"),
            Some(TransmissionType::RtrSynchronous) => "on request, with SYNC".to_owned(),
            Some(TransmissionType::RtrEvent) => "on request".to_owned(),
            Some(TransmissionType::EventManufacturer | TransmissionType::EventProfile) => {
                "event".to_owned()
            }
            None => "reserved".to_owned(),
        };
        format!("{text} ({raw})")
    }

    fn mapping_text(&self) -> String {
        let entry = |it: &MappedObject| {
            format!("{} {} ({})", number((it.index, it.subindex)), it.name, it.bits)
        };
        let entries: Vec<_> = self.mapping.iter().map(entry).collect();
        if entries.is_empty() { "-".to_owned() } else { entries.join(", ") }
    }
}

/// Reads the PDOs of both directions.
pub fn read(client: &mut NodeClient, names: &ObjectNames) -> Result<Vec<NodePdo>> {
    let mut pdos = Vec::new();
    for direction in [PdoDirection::Receive, PdoDirection::Transmit] {
        for offset in 0..MOST {
            match read_one(client, direction, offset, names)? {
                Some(pdo) => pdos.push(pdo),
                None if offset + 1 < USUAL => {}
                None => break,
            }
        }
    }
    Ok(pdos)
}

fn read_one(
    client: &mut NodeClient,
    direction: PdoDirection,
    offset: u16,
    names: &ObjectNames,
) -> Result<Option<NodePdo>> {
    let (kind, communication, mapping) = match direction {
        PdoDirection::Receive => ("RPDO", object::RPDO_COMMUNICATION, object::RPDO_MAPPING),
        PdoDirection::Transmit => ("TPDO", object::TPDO_COMMUNICATION, object::TPDO_MAPPING),
    };
    let (communication, mapping) = (communication + offset, mapping + offset);
    let Some(raw) = client.number(communication, 1)? else { return Ok(None) };
    // An 11-bit COB-ID with further bits is shown as it is.
    let cob_id = PdoCobId::from_raw(raw as u32);
    let transmission = client.number(communication, 2)?.map(|it| it as u8);
    let inhibit_us = client.number(communication, 3)?.map(|it| it * 100);
    let event_timer_ms = client.number(communication, 5)?;
    let count = client.number(mapping, 0)?.unwrap_or(0);
    let mut objects = Vec::new();
    for subindex in 1..=count.min(ENTRIES) as u8 {
        let Some(raw) = client.number(mapping, subindex)? else { break };
        let MappingEntry { index, subindex, bits } = MappingEntry::from_raw(raw as u32);
        let key = (index, subindex);
        let name = names.entry(key).map_or_else(String::new, |_| names.name(key));
        objects.push(MappedObject { index, subindex, bits, name });
    }
    Ok(Some(NodePdo {
        kind,
        number: offset + 1,
        can_id: cob_id.map_or(raw as u32 & 0x1FFF_FFFF, |it| it.id.raw()),
        is_extended: cob_id.is_some_and(|it| it.id.is_extended()),
        is_valid: cob_id.is_some_and(|it| it.is_valid),
        transmission,
        inhibit_us,
        event_timer_ms,
        mapping: objects,
    }))
}

pub fn print(pdos: &[NodePdo], out: &mut dyn Write) -> io::Result<()> {
    let titles = ["PDO", "CAN ID", "VALID", "TRANSMISSION", "INHIBIT", "EVENT", "BITS", "MAPPING"];
    let time = |value: Option<u64>, unit: &str| match value {
        None | Some(0) => "-".to_owned(),
        Some(value) => format!("{value} {unit}"),
    };
    table::print_with_titles(out, titles, pdos, |pdo| {
        [
            pdo.name(),
            format!("0x{:03X}", pdo.can_id),
            if pdo.is_valid { "yes" } else { "no" }.to_owned(),
            pdo.transmission_text(),
            time(pdo.inhibit_us, "us"),
            time(pdo.event_timer_ms, "ms"),
            pdo.bits().to_string(),
            pdo.mapping_text(),
        ]
    })
}
