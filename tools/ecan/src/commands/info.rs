//! `ecan info` and `ecan caps`: state and capabilities of a gateway.

use std::collections::BTreeMap;
use std::io::Write;

use clap::Args;
use ecan_protocol::device::{AlState, Capabilities, assumed_value};
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::object::object;
use serde::Serialize;

use crate::context::{Bus, Context, Failure, Output, Result, Tone};
use crate::output;
use crate::slave_choice::{AllArgument, Recognised};
use crate::value::{Readings, Value, not_read};

#[derive(Debug, Serialize)]
struct Profile {
    bytes: u32,
    chunks: u32,
    channel_mask: u32,
    apply_status: u32,
    pdo_errors: u32,
}

#[derive(Debug, Serialize)]
struct Channel {
    channel: usize,
    #[serde(flatten)]
    state: Option<ChannelState>,
    error: Option<String>,
}

#[derive(Debug, Serialize)]
struct ChannelState {
    status: u16,
    words: String,
    nominal_bitrate: u32,
    data_bitrate: Option<u32>,
}

#[derive(Debug, Serialize)]
struct Info {
    position: u16,
    alias: u16,
    state: String,
    name: String,
    firmware: Option<String>,
    hardware: Option<String>,
    serial: Option<u64>,
    vendor_id: u32,
    product_code: u32,
    revision: u32,
    tx_pdo: Option<Profile>,
    rx_pdo: Option<Profile>,
    channels: Vec<Channel>,
    /// Reasons for missing values, by field name.
    errors: BTreeMap<&'static str, String>,
}

#[derive(Debug, Args)]
pub struct InfoArguments {
    #[command(flatten)]
    all: AllArgument,
}

pub fn run(arguments: &InfoArguments, context: &Context) -> Result {
    let bus = context.bus()?;
    let Recognised { gateways, unknown } = bus.one_or_all(arguments.all.all)?;
    let mut infos = Vec::new();
    let mut failed = unknown.first().map(|first| Failure::Slave(first.to_string()));
    for slave in gateways {
        let mut readings = Readings::default();
        let read = read(&bus, slave, &mut readings);
        match read.and_then(|info| readings.any().map(|()| info)) {
            Ok(info) => {
                infos.push(info);
                failed = failed.or(readings.end().err());
            }
            Err(failure) => failed = failed.or(Some(failure)),
        }
    }
    if !infos.is_empty() {
        context.output.one_or_list(arguments.all.all, &infos, |out| {
            for (number, info) in infos.iter().enumerate() {
                if number != 0 {
                    writeln!(out)?;
                }
                print(info, &context.output, out)?;
            }
            Ok(())
        })?;
    }
    failed.map_or(Ok(()), Err)
}

fn read(bus: &Bus, slave: usize, readings: &mut Readings) -> Result<Info> {
    let known = bus.diagnostics().slave_info(slave)?;
    let mut channels = Vec::new();
    for channel in 0..CHANNELS {
        let state = readings.note(read_channel(bus, slave, channel as u16));
        readings.answers()?;
        let error = state.as_ref().err().cloned();
        channels.push(Channel { channel, state: state.ok(), error });
    }
    let mut errors = BTreeMap::new();
    let mut missing = |name, reason| errors.insert(name, reason);
    let state = AlState::from_status(known.al_state.into());
    let mut text = |name, index| {
        let text = readings.note(bus.text(slave, index));
        text.map_err(|reason| missing(name, reason)).ok()
    };
    let (firmware, hardware) = (text("firmware", 0x100A), text("hardware", 0x1009));
    let serial = readings.note(bus.serial(slave));
    let serial = serial.map_err(|reason| missing("serial", reason)).ok();
    let mut profile = |name, index| {
        let profile = readings.note(read_profile(bus, slave, index));
        profile.map_err(|reason| missing(name, reason)).ok()
    };
    let (tx_pdo, rx_pdo) = (profile("tx_pdo", 0x8010), profile("rx_pdo", 0x8011));
    Ok(Info {
        position: known.position,
        alias: known.alias,
        state: state.map_or_else(|| format!("{:#04x}", known.al_state), |state| state.to_string()),
        name: known.name,
        firmware,
        hardware,
        serial,
        vendor_id: known.vendor_id,
        product_code: known.product_code,
        revision: known.revision_number,
        tx_pdo,
        rx_pdo,
        channels,
        errors,
    })
}

fn read_profile(bus: &Bus, slave: usize, index: u16) -> Result<Profile> {
    let upload = |subindex| bus.read(slave, index, subindex);
    let (word, bytes) = (upload(12)?, upload(9)?);
    Ok(Profile {
        bytes,
        chunks: bytes / 128,
        channel_mask: if bytes == 0 { 0 } else { word >> 5 & 0xFF },
        apply_status: upload(2)?,
        pdo_errors: upload(15)?,
    })
}

fn read_channel(bus: &Bus, slave: usize, channel: u16) -> Result<ChannelState> {
    let (config, information) = (0x8001 + channel, 0x9000 + channel);
    let status = ChannelStatus::from_raw(bus.read(slave, information, 9)? as u16);
    let is_fd = bus.read(slave, config, 15)? == 1;
    Ok(ChannelState {
        status: status.raw(),
        words: status.to_string(),
        nominal_bitrate: bus.read(slave, config, 19)?,
        data_bitrate: if is_fd { Some(bus.read(slave, config, 20)?) } else { None },
    })
}

fn print(info: &Info, output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
    let missing =
        |name| not_read(info.errors.get(name).map_or("", |reason: &String| reason.as_str()));
    let images = |name, profile: &Option<Profile>| {
        let Some(profile) = profile else { return missing(name) };
        let Profile { bytes, chunks, channel_mask, pdo_errors, .. } = profile;
        match bytes {
            0 => "no profile applied".to_owned(),
            _ => format!(
                "{bytes} bytes (N = {chunks}), mask 0x{channel_mask:02X}, {pdo_errors} errors"
            ),
        }
    };
    let text = |name, text: &Option<String>| text.clone().unwrap_or_else(|| missing(name));
    let serial = info.serial.map(|serial| serial.to_string());
    let alias = if info.alias == 0 { String::new() } else { format!(", alias {}", info.alias) };
    let mut rows = vec![
        ["slave".to_owned(), format!("{}{alias}, {}", info.position, info.state)],
        ["name".to_owned(), info.name.clone()],
        ["firmware".to_owned(), text("firmware", &info.firmware)],
        ["hardware".to_owned(), text("hardware", &info.hardware)],
        ["serial".to_owned(), text("serial", &serial)],
        [
            "identity".to_owned(),
            format!(
                "vendor 0x{:08X}, product 0x{:08X}, revision 0x{:08X}",
                info.vendor_id, info.product_code, info.revision
            ),
        ],
        ["TxPDO".to_owned(), images("tx_pdo", &info.tx_pdo)],
        ["RxPDO".to_owned(), images("rx_pdo", &info.rx_pdo)],
    ];
    for channel in &info.channels {
        let name = format!("CAN{}", channel.channel);
        let Some(it) = &channel.state else {
            rows.push([name, not_read(channel.error.as_deref().unwrap_or_default())]);
            continue;
        };
        let rates = match it.data_bitrate {
            None => format!("{} kbit/s", it.nominal_bitrate / 1000),
            Some(data) => format!("{} / {} kbit/s FD", it.nominal_bitrate / 1000, data / 1000),
        };
        let tone = if it.words.contains("bus-off") { Tone::Bad } else { Tone::Faint };
        let status = output.toned(tone, &it.words);
        rows.push([name, format!("{rates}  {status}")]);
    }
    output::print(out, rows, |row| row)
}

#[derive(Debug, Serialize)]
struct Capability {
    position: usize,
    subindex: u8,
    name: &'static str,
    value: Option<u32>,
    meaning: Option<String>,
    error: Option<String>,
    /// Value that the SDK assumes for an entry that the gateway does not have.
    assumed: Option<u32>,
}

pub fn run_caps(context: &Context) -> Result {
    let bus = context.bus()?;
    let slave = bus.slave()?;
    let entries = object(Capabilities::INDEX).map_or(&[][..], |object| object.entries);
    let (mut capabilities, mut readings) = (Vec::new(), Readings::default());
    for subindex in Capabilities::fields() {
        let value = bus.read(slave, Capabilities::INDEX, *subindex);
        let is_missing = matches!(&value, Err(Failure::Device(error)) if error.is_missing_object());
        let value = readings.note(value);
        readings.answers()?;
        let entry = entries.iter().find(|entry| entry.subindex == *subindex);
        capabilities.push(Capability {
            position: slave,
            subindex: *subindex,
            name: entry.map_or("", |entry| entry.name),
            meaning: value
                .as_ref()
                .ok()
                .and_then(|value| Value::Unsigned((*value).into()).meaning(entry)),
            error: value.as_ref().err().cloned(),
            value: value.ok(),
            assumed: assumed_value(Capabilities::INDEX, *subindex).filter(|_| is_missing),
        });
    }
    readings.any()?;
    context.output.data(&capabilities, |out| print_capabilities(&capabilities, out))?;
    readings.end()
}

fn print_capabilities(capabilities: &[Capability], out: &mut dyn Write) -> std::io::Result<()> {
    output::print(out, capabilities, |row| {
        let entry = object(Capabilities::INDEX).and_then(|object| object.entry(row.subindex));
        let value = match row.value {
            Some(value) => Value::Unsigned(value.into()).text(entry),
            None => match row.assumed {
                Some(assumed) => format!(
                    "not reported; assumed: {}",
                    Value::Unsigned(assumed.into()).text(entry)
                ),
                None => not_read(row.error.as_deref().unwrap_or_default()),
            },
        };
        let meaning = row.meaning.clone().unwrap_or_default();
        [format!(":{:02}", row.subindex), row.name.to_owned(), value, meaning]
    })
}
