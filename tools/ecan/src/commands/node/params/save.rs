//! `ecan node params save`, and the DCF that all commands of `params` read.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use ecan_canopen::{
    Commissioning, DataType, DataValue, DeviceFile, NodeId, ObjectEntry, SdoFault, object,
};
use ecan_tool_support::command_line::new_file::WholeFile;
use serde::Serialize;

use crate::commands::node::node_client::{NodeClient, start_for};
use crate::commands::node::node_target::{JsonTarget, SelectedNode, TargetArguments};
use crate::commands::node::object_value::moves_a_motor;
use crate::commands::node::objects::{DeviceFileArguments, ObjectKey, number, read_device_file};
use crate::context::{Context, Failure, Result};
use crate::frames::FrameOptions;
use crate::output::Progress;

#[derive(Debug, Args)]
pub struct SaveArguments {
    /// DCF to write
    file: PathBuf,
    #[command(flatten)]
    target: TargetArguments,
    #[command(flatten)]
    eds: DeviceFileArguments,
    #[command(flatten)]
    options: FrameOptions,
}

/// Object that is not in the DCF.
#[derive(Debug, Serialize)]
struct LeftOut {
    index: u16,
    subindex: u8,
    name: String,
    reason: String,
}

#[derive(Debug, Serialize)]
struct Saved {
    #[serde(flatten)]
    node: JsonTarget,
    file: String,
    values: usize,
    left_out: Vec<LeftOut>,
}

pub const SDO_TIMEOUT: Duration = Duration::from_millis(500);

pub fn run(arguments: &SaveArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.options.capture.is_on_output());
    let selected = arguments.target.select(&arguments.options, context)?;
    let Some((name, device)) = arguments.eds.load(&selected)? else {
        let message = "the objects of the node are not known; use its device file: --eds FILE, or \
                       `device_file` of the node in --config";
        return Err(Failure::Usage(message.to_owned()));
    };
    // Before the node is read, so that faults of the file are known at once.
    let write_failure = |error| Failure::file("write", &arguments.file, error);
    let out = WholeFile::create(&arguments.file, arguments.options.capture.existing())
        .map_err(write_failure)?;
    let link = start_for(&selected, true, context)?;
    let read = NodeClient::new(link, selected.target, SDO_TIMEOUT).run(|client| {
        check(client, &device, &name)?;
        let bit_rate =
            client.link.service.can(0, selected.target.channel).map(|can| can.nominal_bitrate);
        let _progress = Progress::show(format!("reading {}", selected.target));
        let commissioning = commissioning(client, &selected, bit_rate)?;
        let mut dcf = device.to_dcf(commissioning);
        dcf.file_info.file_name =
            arguments.file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let (values, left_out) = read_values(client, &device, &mut dcf)?;
        let file = arguments.file.display().to_string();
        Ok((dcf, Saved { node: client.json(), file, values, left_out }))
    });
    let (dcf, saved) = read?;
    out.finish(dcf.write().as_bytes()).map_err(write_failure)?;
    context.output.data(&saved, |out| {
        let Saved { file, values, left_out, .. } = &saved;
        for LeftOut { index, subindex, name, reason } in left_out {
            writeln!(out, "{} {name}: not saved: {reason}", number((*index, *subindex)))?;
        }
        writeln!(out, "{file}: {values} values of {}", selected.target)
    })
}

/// Node-ID, bit rate and serial number of the node.
fn commissioning(
    client: &mut NodeClient,
    selected: &SelectedNode,
    bit_rate: Option<u32>,
) -> Result<Commissioning> {
    let serial = client.number(object::IDENTITY, 4)?;
    let name = selected
        .description
        .as_ref()
        .map(|description| description.name.clone())
        .unwrap_or_default();
    Ok(Commissioning {
        node_id: Some(selected.target.node),
        node_name: name,
        bit_rate_kbit: bit_rate.and_then(|bit_rate| u16::try_from(bit_rate / 1_000).ok()),
        lss_serial_number: serial.and_then(|serial| u32::try_from(serial).ok()),
        ..Commissioning::default()
    })
}

/// Reads the parameters of the node into the DCF; returns their number, and those without a value.
fn read_values(
    client: &mut NodeClient,
    device: &DeviceFile,
    dcf: &mut DeviceFile,
) -> Result<(usize, Vec<LeftOut>)> {
    let (mut values, mut left_out) = (0, Vec::new());
    for entry in device.parameters().filter(|entry| is_parameter(entry.index)) {
        let (index, subindex) = (entry.index, entry.subindex);
        crate::output::step();
        let reason = match client.try_upload(index, subindex)? {
            // A DCF has no form for a text without characters.
            Ok(data) if is_empty(entry.data_type, &data) => "empty text".to_owned(),
            Ok(data) => match dcf.set_parameter(index, subindex, &data) {
                Ok(_) => {
                    values += 1;
                    continue;
                }
                Err(error) => error.to_string(),
            },
            Err(fault @ SdoFault::Aborted(_)) => fault.to_string(),
            Err(_) => {
                // Returns the failure with its remedy.
                client.upload(index, subindex)?;
                continue;
            }
        };
        left_out.push(LeftOut { index, subindex, name: device.label(entry), reason });
    }
    Ok((values, left_out))
}

fn is_empty(data_type: DataType, data: &[u8]) -> bool {
    let is_text = matches!(data_type, DataType::VisibleString | DataType::UnicodeString);
    data.is_empty() || is_text && data.iter().all(|byte| *byte == 0)
}

/// Program download (CiA 302-3): a write can erase the firmware.
const PROGRAMS: std::ops::RangeInclusive<u16> = 0x1F50..=0x1F5F;

/// Returns whether an object is a parameter, and no command.
pub fn is_parameter(index: u16) -> bool {
    !moves_a_motor(index) && !PROGRAMS.contains(&index)
}

/// Reads a DCF.
///
/// # Errors
/// The file cannot be read, or it is an EDS, which has no values.
pub fn read(path: &Path) -> Result<DeviceFile> {
    let file = read_device_file(path)?;
    match file.is_dcf() {
        true => Ok(file),
        false => Err(Failure::file(
            "use",
            path,
            "an EDS has no values of a node; use a DCF, for example of `ecan node params save`",
        )),
    }
}

/// Value of a parameter in a DCF.
#[derive(Clone, Debug)]
pub struct StoredValue<'f> {
    pub entry: &'f ObjectEntry,
    pub value: DataValue,
}

impl StoredValue<'_> {
    pub fn key(&self) -> ObjectKey {
        (self.entry.index, self.entry.subindex)
    }

    /// Returns whether the bytes of the node are this value.
    pub fn is_same(&self, bytes: &[u8]) -> bool {
        decode(self.entry.data_type, bytes).as_ref() == Some(&self.value)
    }
}

/// The parameters of a DCF that can be read from a node, with their values, in the order of index and
/// subindex.
pub fn values(file: &DeviceFile, node: NodeId) -> Vec<StoredValue<'_>> {
    let entries = file.parameters().filter(|entry| is_parameter(entry.index));
    let value = |entry| {
        let value = ObjectEntry::parameter_value(entry, node)?;
        Some(StoredValue { entry, value })
    };
    entries.filter_map(value).collect()
}

/// The value of these bytes; of a text without the zeros at its end. `None` for another length.
pub fn decode(data_type: DataType, bytes: &[u8]) -> Option<DataValue> {
    data_type.decode(bytes).ok().map(|value| match value {
        DataValue::Text(text) => DataValue::Text(text.trim_end_matches('\0').into()),
        value => value,
    })
}

/// Rejects a node that is another device than the one of the file.
///
/// # Errors
/// Vendor-ID or product code differ; the node does not answer.
pub fn check(client: &mut NodeClient, file: &DeviceFile, name: &str) -> Result {
    let info = &file.device_info;
    let parts = [("vendor-ID", 1, info.vendor_number), ("product code", 2, info.product_number)];
    for (what, subindex, expected) in parts {
        let Some(expected) = expected.filter(|expected| *expected != 0) else { continue };
        let Some(found) = client.number(object::IDENTITY, subindex)? else { continue };
        if found != u64::from(expected) {
            return Err(Failure::Rejected(format!(
                "{} has {what} 0x{found:08X}, and {name} is for 0x{expected:08X}; use the file of \
                 this device",
                client.target()
            )));
        }
    }
    Ok(())
}
