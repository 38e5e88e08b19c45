//! `ecan node params save`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use ecan_canopen::{Commissioning, DataType, DeviceFile, SdoFault, object};
use ecan_tool_support::command_line::new_file::WholeFile;
use serde::Serialize;

use crate::commands::node::node_client::{NodeClient, start_for};
use crate::commands::node::node_target::{JsonTarget, SelectedNode, TargetArguments};
use crate::commands::node::object_names::{DeviceFileArguments, number};
use crate::context::{Context, Failure, Result};
use crate::frames::FrameOptions;
use crate::progress::Progress;

use super::{dcf_file, identity};

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

const SDO_TIMEOUT: Duration = Duration::from_millis(500);

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
        identity::check(client, &device, &name)?;
        let bit_rate =
            client.link.service.can(0, selected.target.channel).map(|it| it.nominal_bitrate);
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
    let name = selected.description.as_ref().map(|it| it.name.clone()).unwrap_or_default();
    Ok(Commissioning {
        node_id: Some(selected.target.node),
        node_name: name,
        bit_rate_kbit: bit_rate.and_then(|it| u16::try_from(it / 1_000).ok()),
        lss_serial_number: serial.and_then(|it| u32::try_from(it).ok()),
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
    for entry in device.parameters().filter(|it| dcf_file::is_parameter(it.index)) {
        let (index, subindex) = (entry.index, entry.subindex);
        crate::progress::step();
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
