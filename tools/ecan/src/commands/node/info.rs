//! `ecan node info`: a node at a glance.

use std::io::{self, Write};
use std::time::Duration;

use clap::Args;
use ecan_canopen::{
    ErrorRegister, HeartbeatConsumer, NmtState, OperatingMode, Statusword, SupportedModes, object,
};
use serde::Serialize;

use super::node_client::{NodeClient, start_for};
use super::node_target::{JsonTarget, PositionalTarget};
use super::object_value::{DeviceType, error_text, modes_text, status_text};
use super::objects::{DeviceFileArguments, ObjectNames};
use super::pdo;
use super::pdo::NodePdo;
use super::scan::state_name;
use crate::context::{Context, Failure, Output, Result, Tone};
use crate::frames::FrameOptions;
use crate::output;

#[derive(Debug, Args)]
pub struct InfoArguments {
    #[command(flatten)]
    target: PositionalTarget,
    #[command(flatten)]
    eds: DeviceFileArguments,
    #[command(flatten)]
    options: FrameOptions,
}

#[derive(Debug, Serialize)]
struct Drive {
    statusword: u64,
    state: String,
    mode: Option<String>,
    supported_modes: Option<String>,
    error_code: Option<u64>,
}

#[derive(Debug, Serialize)]
struct Consumer {
    producer: u8,
    time_ms: u16,
}

/// Comparison with a device file.
#[derive(Debug, Serialize)]
struct FileMatch {
    file: String,
    differences: Vec<String>,
}

#[derive(Debug, Serialize)]
struct Info {
    #[serde(flatten)]
    node: JsonTarget,
    device_type: u64,
    device_type_text: String,
    name: Option<String>,
    hardware_version: Option<String>,
    software_version: Option<String>,
    vendor_id: Option<u64>,
    product_code: Option<u64>,
    revision: Option<u64>,
    serial: Option<u64>,
    error_register: Option<u64>,
    /// State by heartbeat; `None` if the node sends none.
    state: Option<&'static str>,
    producer_heartbeat_ms: Option<u64>,
    consumed_heartbeats: Vec<Consumer>,
    guard_time_ms: Option<u64>,
    drive: Option<Drive>,
    pdos: Vec<NodePdo>,
    device_file: Option<FileMatch>,
}

const SDO_TIMEOUT: Duration = Duration::from_millis(500);
/// Longest time to wait for a heartbeat.
const MOST_HEARTBEAT_MS: u64 = 5_000;
const GUARD_TIME: u16 = 0x100C;

pub fn run(arguments: &InfoArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.options.capture.is_on_output());
    let selected = arguments.target.select(&arguments.options, context)?;
    let names = ObjectNames::of(&arguments.eds, &selected)?;
    let link = start_for(&selected, true, context)?;
    let client = NodeClient::new(link, selected.target, SDO_TIMEOUT);
    let info = client.run(|client| read(client, &names))?;
    context.output.data(&info, |out| print(&info, &context.output, out))?;
    match info.device_file.as_ref().is_some_and(|device_file| !device_file.differences.is_empty()) {
        true => Err(Failure::ProblemsFound),
        false => Ok(()),
    }
}

fn read(client: &mut NodeClient, names: &ObjectNames) -> Result<Info> {
    // Mandatory: without it the node is not reached.
    let device_type = super::node_client::decode_unsigned(&client.upload(object::DEVICE_TYPE, 0)?);
    let (vendor_id, product_code) =
        (client.number(object::IDENTITY, 1)?, client.number(object::IDENTITY, 2)?);
    let mut consumed = Vec::new();
    let consumers = client.number(object::CONSUMER_HEARTBEAT, 0)?.unwrap_or(0);
    for subindex in 1..=consumers.min(127) as u8 {
        let raw = client.number(object::CONSUMER_HEARTBEAT, subindex)?.unwrap_or(0);
        let consumer = HeartbeatConsumer::from_raw(raw as u32);
        consumed.extend(consumer.map(|consumer| Consumer {
            producer: consumer.producer.get(),
            time_ms: consumer.time_ms,
        }));
    }
    let is_drive = DeviceType(device_type as u32).is_drive();
    let producer_heartbeat_ms = client.number(object::PRODUCER_HEARTBEAT, 0)?;
    Ok(Info {
        node: client.json(),
        device_type,
        device_type_text: DeviceType(device_type as u32).to_string(),
        name: text(client, object::DEVICE_NAME)?,
        hardware_version: text(client, object::HARDWARE_VERSION)?,
        software_version: text(client, object::SOFTWARE_VERSION)?,
        vendor_id,
        product_code,
        revision: client.number(object::IDENTITY, 3)?,
        serial: client.number(object::IDENTITY, 4)?,
        error_register: client.number(object::ERROR_REGISTER, 0)?,
        producer_heartbeat_ms,
        consumed_heartbeats: consumed,
        guard_time_ms: client.number(GUARD_TIME, 0)?,
        drive: if is_drive { read_drive(client)? } else { None },
        pdos: pdo::read(client, names)?,
        device_file: compare(names, vendor_id, product_code),
        state: state(client, producer_heartbeat_ms.unwrap_or(0))?.map(state_name),
    })
}

fn text(client: &mut NodeClient, index: u16) -> Result<Option<String>> {
    let data = client.upload_optional(index, 0)?;
    Ok(data.map(|data| String::from_utf8_lossy(&data).trim_end_matches('\0').trim().to_owned()))
}

fn read_drive(client: &mut NodeClient) -> Result<Option<Drive>> {
    let Some(statusword) = client.number(object::STATUSWORD, 0)? else { return Ok(None) };
    let mode = client.number(object::MODE_DISPLAY, 0)?.map(|raw| {
        match (OperatingMode::from_raw(raw as i8), raw as i8) {
            (Some(mode), _) => mode.to_string(),
            (None, 0) => "none".to_owned(),
            (None, other) => format!("{other}, of the manufacturer"),
        }
    });
    let supported = client.number(object::SUPPORTED_MODES, 0)?;
    Ok(Some(Drive {
        statusword,
        state: status_text(Statusword(statusword as u16)),
        mode,
        supported_modes: supported.map(|supported| modes_text(SupportedModes(supported as u32))),
        error_code: client.number(object::ERROR_CODE, 0)?,
    }))
}

/// Waits for a heartbeat, if the node sends any.
fn state(client: &mut NodeClient, period_ms: u64) -> Result<Option<NmtState>> {
    if period_ms > 0 {
        let time = Duration::from_millis((period_ms * 2 + 100).min(MOST_HEARTBEAT_MS));
        client.run_for(time, |observed| observed.state().is_some())?;
    }
    Ok(client.state())
}

/// Compares the identity with that of the device file.
fn compare(names: &ObjectNames, vendor: Option<u64>, product: Option<u64>) -> Option<FileMatch> {
    let (file, device) = names.file()?;
    let info = &device.device_info;
    let difference = |what: &str, node: Option<u64>, file: Option<u32>| {
        let (node, file) = (node?, u64::from(file?));
        (node != file).then(|| format!("{what} is 0x{node:08X}, in the file 0x{file:08X}"))
    };
    let differences = [
        difference("vendor-ID", vendor, info.vendor_number),
        difference("product code", product, info.product_number),
    ];
    let differences = differences.into_iter().flatten().collect();
    Some(FileMatch { file: file.to_owned(), differences })
}

fn print(info: &Info, output: &Output, out: &mut dyn Write) -> io::Result<()> {
    let JsonTarget { slave, channel, node } = info.node;
    let missing = || "-".to_owned();
    let hexadecimal =
        |value: Option<u64>| value.map_or_else(missing, |value| format!("0x{value:08X}"));
    let string = |value: &Option<String>| value.clone().unwrap_or_else(missing);
    let state = info.state.unwrap_or("not reported (no heartbeat)");
    let versions = (string(&info.hardware_version), string(&info.software_version));
    let identity = format!(
        "vendor {}, product {}, revision {}, serial {}",
        hexadecimal(info.vendor_id),
        hexadecimal(info.product_code),
        hexadecimal(info.revision),
        info.serial.map_or_else(missing, |serial| serial.to_string())
    );
    let mut rows = vec![
        ["node".to_owned(), format!("{node} on can{channel} of slave {slave}")],
        [
            "device type".to_owned(),
            format!("{}, 0x{:08X}", info.device_type_text, info.device_type),
        ],
        ["name".to_owned(), string(&info.name)],
        ["versions".to_owned(), format!("hardware {}, software {}", versions.0, versions.1)],
        ["identity".to_owned(), identity],
        ["NMT state".to_owned(), state.to_owned()],
        ["error register".to_owned(), register_text(info, output)],
        ["heartbeat".to_owned(), heartbeat_text(info)],
    ];
    if let Some(drive) = &info.drive {
        let Drive { statusword, state, mode, supported_modes, error_code } = drive;
        rows.push(["drive".to_owned(), format!("{state} (statusword 0x{statusword:04X})")]);
        let modes = supported_modes.as_deref().unwrap_or("not stated");
        let mode = mode.as_deref().unwrap_or("not stated");
        rows.push(["mode".to_owned(), format!("{mode}; supported: {modes}")]);
        if let Some(code) = error_code {
            let text = format!("0x{code:04X} {}", error_text(*code as u16));
            let tone = if *code == 0 { Tone::Faint } else { Tone::Bad };
            rows.push(["error code".to_owned(), output.toned(tone, text)]);
        }
    }
    for kind in ["RPDO", "TPDO"] {
        let of_kind = || info.pdos.iter().filter(|pdo| pdo.kind == kind);
        let valid: Vec<_> = of_kind()
            .filter(|pdo| pdo.is_valid)
            .map(|pdo| format!("{} (0x{:03X}, {} bits)", pdo.number, pdo.can_id, pdo.bits()))
            .collect();
        let names =
            if valid.is_empty() { String::new() } else { format!(": {}", valid.join(", ")) };
        let text = format!("{} of {} valid{names}", valid.len(), of_kind().count());
        rows.push([format!("{kind}s"), text]);
    }
    if let Some(FileMatch { file, differences }) = &info.device_file {
        let text = match differences.is_empty() {
            true => format!("{file}: identity matches"),
            false => output.toned(Tone::Bad, format!("{file}: {}", differences.join(", "))),
        };
        rows.push(["device file".to_owned(), text]);
    }
    output::print(out, rows, |row| row)
}

fn register_text(info: &Info, output: &Output) -> String {
    match info.error_register {
        None => "-".to_owned(),
        Some(0) => ErrorRegister(0).to_string(),
        Some(raw) => output.toned(Tone::Bad, ErrorRegister(raw as u8)),
    }
}

fn heartbeat_text(info: &Info) -> String {
    let producer = match info.producer_heartbeat_ms {
        None => "not supported".to_owned(),
        Some(0) => "off".to_owned(),
        Some(ms) => format!("every {ms} ms"),
    };
    let consumers: Vec<_> = info
        .consumed_heartbeats
        .iter()
        .map(|consumer| format!("node {} within {} ms", consumer.producer, consumer.time_ms))
        .collect();
    let consumers = if consumers.is_empty() { "none".to_owned() } else { consumers.join(", ") };
    let guarding = match info.guard_time_ms {
        None | Some(0) => String::new(),
        Some(ms) => format!("; guarded every {ms} ms"),
    };
    format!("{producer}; watches: {consumers}{guarding}")
}
