//! `ecan node pdo`: communication, mapping and live values of the PDOs.

use std::collections::HashMap;
use std::io;
use std::io::Write;
use std::time::Duration;

use clap::Args;
use ecan_canopen::{DataType, MappingEntry, PdoCobId, PdoDirection, TransmissionType, object};
use ecan_protocol::can::CanId;
use serde::Serialize;

use super::node_client::{NodeClient, start_for};
use super::node_link::Observed;
use super::node_target::{LiveViewArguments, PositionalTarget};
use super::object_value::ObjectValue;
use super::objects::{DeviceFileArguments, ObjectNames, number};
use crate::context::{Context, Failure, Result};
use crate::frames::FrameOptions;
use crate::output;

#[derive(Debug, Args)]
pub struct PdoArguments {
    #[command(flatten)]
    target: PositionalTarget,
    #[command(flatten)]
    eds: DeviceFileArguments,
    /// Print the values of each PDO on the bus whenever they change
    #[arg(long)]
    watch: bool,
    #[command(flatten)]
    view: LiveViewArguments,
    #[command(flatten)]
    options: FrameOptions,
}

#[derive(Debug, Serialize)]
struct LiveValue {
    index: u16,
    subindex: u8,
    name: String,
    value: serde_json::Value,
    text: String,
    meaning: Option<String>,
}

#[derive(Debug, Serialize)]
struct LivePdo<'a> {
    /// Seconds since the start of the command.
    seconds: f64,
    pdo: &'a str,
    values: Vec<LiveValue>,
}

const SDO_TIMEOUT: Duration = Duration::from_millis(500);

pub fn run(arguments: &PdoArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.options.capture.is_on_output());
    let selected = arguments.target.select(&arguments.options, context)?;
    let target = selected.target;
    let names = ObjectNames::of(&arguments.eds, &selected)?;
    let has_end = !arguments.watch || arguments.view.has_end();
    let link = start_for(&selected, has_end, context)?;
    NodeClient::new(link, target, SDO_TIMEOUT).run(|client| {
        let pdos = read(client, &names)?;
        if arguments.watch {
            return watch(arguments.view, client, &pdos, &names, context);
        }
        context.output.data(&pdos, |out| match pdos.is_empty() {
            true => writeln!(out, "{target} has no PDO"),
            false => print(&pdos, out),
        })
    })
}

/// Prints changed PDOs until the user stops, or the options end it.
fn watch(
    arguments: LiveViewArguments,
    client: &mut NodeClient,
    pdos: &[NodePdo],
    names: &ObjectNames,
    context: &Context,
) -> Result {
    let mut view = arguments.start(&client.link.service);
    let mut known: HashMap<usize, Vec<u8>> = HashMap::new();
    loop {
        let mut received: Vec<Observed> = Vec::new();
        let channel = client.target().channel;
        let cycle = client.link.cycle(&mut [], |observed| {
            // Also the RPDOs that another program sends.
            if (observed.frame.gateway, observed.frame.channel) == (0, channel) {
                received.push(*observed);
            }
        });
        let Some(now_ns) = view.after_cycle(cycle)? else { return Ok(()) };
        for it in received {
            let frame = it.frame.frame;
            let is_it = |pdo: &NodePdo| pdo.is_sent_with(frame.as_ref().id());
            let Some(nth) = pdos.iter().position(is_it) else { continue };
            let (Some(pdo), false) = (pdos.get(nth), frame.as_ref().is_remote()) else { continue };
            view.receive(now_ns);
            if known.get(&nth).is_some_and(|data| data == frame.data()) {
                continue;
            }
            known.insert(nth, frame.data().to_vec());
            print_live(pdo, frame.data(), view.seconds(it.time_ns), names, context)?;
            if view.count_line() {
                return Ok(());
            }
        }
        if view.has_timed_out(now_ns) {
            let target = client.target();
            return match view.count.unwrap_or(1) > view.printed {
                true => Err(Failure::Incomplete(format!(
                    "no further PDO of {target} received; a node sends PDOs in the state \
                     operational: `ecan node info` shows it"
                ))),
                false => Ok(()),
            };
        }
    }
}

fn print_live(
    pdo: &NodePdo,
    data: &[u8],
    seconds: f64,
    names: &ObjectNames,
    context: &Context,
) -> Result {
    let name = pdo.name();
    let live = LivePdo { seconds, pdo: &name, values: values(&pdo.mapping, data, names) };
    let mut stream = context.output.stream();
    if context.global.json {
        let json = serde_json::to_string(&live).map_err(std::io::Error::from)?;
        writeln!(stream, "{}", output::with_simulated(json))?;
    } else {
        let value = |value: &LiveValue| {
            let name = match value.name.is_empty() {
                true => number((value.index, value.subindex)),
                false => value.name.clone(),
            };
            let meaning =
                value.meaning.as_ref().map_or_else(String::new, |meaning| format!(": {meaning}"));
            format!("{name} = {}{meaning}", value.text)
        };
        let values: Vec<_> = live.values.iter().map(value).collect();
        let values = if values.is_empty() { "no values".to_owned() } else { values.join(", ") };
        writeln!(stream, "{seconds:9.3}  {name}  {values}")?;
    }
    stream.flush()?;
    Ok(())
}

/// Values of the mapped objects whose bits the frame has.
fn values(mapping: &[MappedObject], data: &[u8], names: &ObjectNames) -> Vec<LiveValue> {
    let mut at = 0;
    let mut values = Vec::new();
    for it in mapping {
        let Some(bytes) = bits(data, at, usize::from(it.bits)) else { break };
        at += usize::from(it.bits);
        let key = (it.index, it.subindex);
        // Dummy entries have no value: their index is that of a data type.
        if it.index <= 0x1F {
            continue;
        }
        let data_type: Option<DataType> = names.entry(key).map(|entry| entry.data_type);
        let value = ObjectValue::new(bytes, data_type);
        values.push(LiveValue {
            index: it.index,
            subindex: it.subindex,
            name: it.name.clone(),
            value: value.json(),
            text: value.text(),
            meaning: value.meaning(key),
        });
    }
    values
}

/// The bytes of a value of `count` bits from bit `at`; `None` if the frame is shorter.
fn bits(data: &[u8], at: usize, count: usize) -> Option<Vec<u8>> {
    if at + count > data.len() * 8 {
        return None;
    }
    let bit =
        |number: usize| data.get(number / 8).is_some_and(|byte| byte >> (number % 8) & 1 == 1);
    let mut bytes = vec![0; count.div_ceil(8)];
    for (nth, byte) in bytes.iter_mut().enumerate() {
        for place in 0..8.min(count - nth * 8) {
            *byte |= u8::from(bit(at + nth * 8 + place)) << place;
        }
    }
    Some(bytes)
}

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
        self.mapping.iter().map(|entry| u32::from(entry.bits)).sum()
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
        let entry = |object: &MappedObject| {
            format!("{} {} ({})", number((object.index, object.subindex)), object.name, object.bits)
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
    let transmission = client.number(communication, 2)?.map(|value| value as u8);
    let inhibit_us = client.number(communication, 3)?.map(|value| value * 100);
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
        can_id: cob_id.map_or(raw as u32 & 0x1FFF_FFFF, |cob_id| cob_id.id.raw()),
        is_extended: cob_id.is_some_and(|cob_id| cob_id.id.is_extended()),
        is_valid: cob_id.is_some_and(|cob_id| cob_id.is_valid),
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
    output::print_with_titles(out, titles, pdos, |pdo| {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_decoded_by_the_mapping() {
        let names = ObjectNames::standard();
        let mapped =
            |index, bits| MappedObject { index, subindex: 0, bits, name: names.name((index, 0)) };
        let mapping = [mapped(0x6041, 16), mapped(0x0005, 8), mapped(0x6064, 32)];
        let data = [0x37, 0x06, 0xEE, 0x9C, 0xFF, 0xFF, 0xFF];
        let values = values(&mapping, &data, &names);
        let texts: Vec<_> =
            values.iter().map(|value| (value.text.as_str(), value.meaning.as_deref())).collect();
        assert_eq!(texts, [("1591 (0x637)", Some("operation enabled")), ("-100", None)]);
        let short = super::values(&mapping, &data[..4], &names);
        assert_eq!(short.len(), 1, "the position is not complete");
    }

    #[test]
    fn bits_across_bytes_are_extracted() {
        assert_eq!(bits(&[0b1010_0000, 0b0000_0011], 5, 5), Some(vec![0b0001_1101]));
        assert_eq!(bits(&[0xFF, 0x01], 0, 9), Some(vec![0xFF, 0x01]));
        assert_eq!(bits(&[0xFF], 4, 5), None);
    }
}
