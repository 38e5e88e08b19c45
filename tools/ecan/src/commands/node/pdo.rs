//! `ecan node pdo`: communication, mapping and live values of the PDOs.

use std::collections::HashMap;
use std::io::Write;
use std::time::Duration;

use clap::Args;
use ecan_canopen::DataType;
use serde::Serialize;

use crate::context::{Context, Failure, Result};
use crate::frames::FrameOptions;

use super::live_view::LiveViewArguments;
use super::node_client::{NodeClient, start_for};
use super::node_link::Observed;
use super::node_target::PositionalTarget;
use super::object_names::{DeviceFileArguments, ObjectNames, number};
use super::object_value::ObjectValue;
use super::pdo_table::{self, MappedObject, NodePdo};

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
        let pdos = pdo_table::read(client, &names)?;
        if arguments.watch {
            return watch(arguments.view, client, &pdos, &names, context);
        }
        context.output.data(&pdos, |out| match pdos.is_empty() {
            true => writeln!(out, "{target} has no PDO"),
            false => pdo_table::print(&pdos, out),
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
        let cycle = client.link.cycle(&mut [], |it| {
            // Also the RPDOs that another program sends.
            if (it.frame.gateway, it.frame.channel) == (0, channel) {
                received.push(*it);
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
        writeln!(stream, "{json}")?;
    } else {
        let value = |it: &LiveValue| {
            let name = match it.name.is_empty() {
                true => number((it.index, it.subindex)),
                false => it.name.clone(),
            };
            let meaning = it.meaning.as_ref().map_or_else(String::new, |it| format!(": {it}"));
            format!("{name} = {}{meaning}", it.text)
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
            values.iter().map(|it| (it.text.as_str(), it.meaning.as_deref())).collect();
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
