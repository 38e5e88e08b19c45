//! `ecan node params restore` and `diff`: values of a DCF compared with, and written to, a node.

use std::io;
use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use ecan_canopen::{
    Commissioning, DeviceFile, Download, DownloadScope, DriveState, SdoDirection, SdoFault,
    Statusword, object,
};
use serde::Serialize;

use super::save;
use super::save::SDO_TIMEOUT;
use crate::commands::node::node_client::{NodeClient, start_for};
use crate::commands::node::node_target::{JsonTarget, NodeTarget, TargetArguments};
use crate::commands::node::object_value::{ObjectValue, status_text};
use crate::commands::node::objects::number;
use crate::context::{Context, Failure, Output, Result, Tone};
use crate::frames::FrameOptions;
use crate::output;
use crate::output::{Progress, confirm};

#[derive(Debug, Args)]
pub struct RestoreArguments {
    /// DCF to restore
    file: PathBuf,
    #[command(flatten)]
    target: TargetArguments,
    /// Restore only objects from 0x2000 on, without communication
    #[arg(long)]
    application: bool,
    /// Then store all parameters in the node: 0x1010:01
    #[arg(long)]
    store: bool,
    /// Restore without asking
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    options: FrameOptions,
}

/// A value that the node did not take.
#[derive(Debug, Serialize)]
struct NotRestored {
    index: u16,
    subindex: u8,
    name: String,
    file_text: String,
    /// Value of the node after the write.
    node_text: Option<String>,
    /// Rejection by the node.
    error: Option<String>,
}

#[derive(Debug, Serialize)]
struct Restored {
    #[serde(flatten)]
    node: JsonTarget,
    file: String,
    /// Writes, among them those that disable a PDO while it changes.
    written: usize,
    verified: usize,
    is_stored: bool,
    /// Reason why the node did not store them.
    store_error: Option<String>,
    not_restored: Vec<NotRestored>,
}

/// Distance of the objects of the axes of a drive (CiA 402-2, 5), and their number.
const AXIS_OFFSET: u16 = 0x800;
const AXES: u16 = 8;
/// First index that does not belong to the communication.
const APPLICATION: u16 = 0x2000;
/// Value of 0x1010 that stores (CiA 301, 7.5.2.13).
const SAVE: [u8; 4] = *b"save";

pub fn run(arguments: &RestoreArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.options.capture.is_on_output());
    let selected = arguments.target.select(&arguments.options, context)?;
    let target = selected.target;
    let dcf = save::read(&arguments.file)?;
    let name = arguments.file.display().to_string();
    check_node_id(&dcf, target, &name, arguments.application)?;
    let downloads = dcf.downloads(target.node, DownloadScope::All);
    let mut downloads = downloads.map_err(|error| Failure::file("use", &arguments.file, error))?;
    downloads.retain(|download| {
        save::is_parameter(download.index)
            && (!arguments.application || download.index >= APPLICATION)
    });
    if downloads.is_empty() {
        let message = "the file has no value to restore; see `ecan node params save`";
        return Err(Failure::file("use", &arguments.file, message));
    }
    let stored = if arguments.store { ", and store them" } else { "" };
    confirm(
        arguments.yes,
        &format!("writing {name} to {target}"),
        format_args!("Write {} values of {name} to {target}{stored}. Continue?", downloads.len()),
        "nothing was written",
    )?;
    let link = start_for(&selected, true, context)?;
    let restored = NodeClient::new(link, target, SDO_TIMEOUT).run(|client| {
        save::check(client, &dcf, &name)?;
        check_off(client)?;
        let _progress = Progress::show(format!("writing {target}"));
        let mut not_restored = Vec::new();
        let verified = write_all(client, &dcf, &downloads, &mut not_restored)?;
        let mut is_stored = arguments.store && not_restored.is_empty();
        let mut store_error = None;
        if is_stored {
            let stored = client.download(object::STORE_PARAMETERS, 1, &SAVE);
            store_error = stored.err().map(|error| error.to_string());
            is_stored = store_error.is_none();
        }
        let (node, written) = (client.json(), downloads.len());
        let file = name;
        Ok(Restored { node, file, written, verified, is_stored, store_error, not_restored })
    })?;
    context.output.data(&restored, |out| print(&restored, &context.output, out))?;
    let count = restored.not_restored.len();
    match (count, restored.store_error) {
        (0, None) => Ok(()),
        (0, Some(error)) => Err(Failure::Rejected(format!(
            "the values are active until a reset, not stored: {error}"
        ))),
        _ => Err(Failure::Rejected(format!(
            "{count} values of {target} were not restored{}; if the node rejects PDOs, command it to \
             pre-operational: `ecan node nmt preop`",
            if arguments.store { ", and nothing was stored" } else { "" }
        ))),
    }
}

/// The COB-IDs of a file belong to its node-ID.
fn check_node_id(
    dcf: &DeviceFile,
    target: NodeTarget,
    name: &str,
    is_application_only: bool,
) -> Result {
    let of_file =
        dcf.commissioning.as_ref().and_then(|commissioning: &Commissioning| commissioning.node_id);
    match of_file.filter(|node| *node != target.node && !is_application_only) {
        None => Ok(()),
        Some(other) => Err(Failure::Usage(format!(
            "{name} is of node {other}, with its COB-IDs; for {target} use --application, which \
             restores objects from 0x2000 on"
        ))),
    }
}

/// Rejects a drive with an axis that is not off: its motor could move or fall while it changes.
fn check_off(client: &mut NodeClient) -> Result {
    for axis in 0..AXES {
        let index = object::STATUSWORD + axis * AXIS_OFFSET;
        let Some(raw) = client.number(index, 0)? else { break };
        let status = Statusword(raw as u16);
        if status.state().is_none_or(has_torque) {
            return Err(Failure::Rejected(format!(
                "{} is a drive in the state \"{}\" ({} = 0x{raw:04X}); switch it off first, for \
                 example with `ecan axis stop`, or end the application that moves it",
                client.target(),
                status_text(status),
                number((index, 0))
            )));
        }
    }
    Ok(())
}

/// Returns whether the motor can have torque (statusword bit 2).
fn has_torque(state: DriveState) -> bool {
    use DriveState::{FaultReactionActive, OperationEnabled, QuickStopActive};
    matches!(state, OperationEnabled | QuickStopActive | FaultReactionActive)
}

/// Writes the values in their order, then reads them; returns the number of values that are right.
fn write_all(
    client: &mut NodeClient,
    dcf: &DeviceFile,
    downloads: &[Download],
    not_restored: &mut Vec<NotRestored>,
) -> Result<usize> {
    let mut rejected = Vec::new();
    for Download { index, subindex, data } in downloads {
        crate::output::step();
        match client.try_download(*index, *subindex, data)? {
            Ok(_) => {}
            Err(fault @ SdoFault::Aborted(_)) => rejected.push(((*index, *subindex), fault)),
            Err(fault) => {
                let object = (SdoDirection::Download, *index, *subindex);
                return Err(client.failure(object, fault));
            }
        }
    }
    let mut verified = 0;
    for stored in last_values(downloads) {
        let Download { index, subindex, data } = stored;
        let key = (*index, *subindex);
        let entry = dcf.entry(*index, *subindex);
        let data_type = entry.map(|entry| entry.data_type);
        let fault = rejected.iter().find(|rejected| rejected.0 == key).map(|found| found.1);
        crate::output::step();
        let found = match entry.is_some_and(|entry| entry.access.is_readable()) {
            true => client.upload_optional(*index, *subindex)?,
            false => None,
        };
        let is_same = |found: &Vec<u8>| {
            let value = |bytes: &[u8]| save::decode(data_type?, bytes);
            found == data || (value(found).is_some() && value(found) == value(data))
        };
        match (&found, fault) {
            (Some(found), _) if is_same(found) => verified += 1,
            // An object that can only be written.
            (None, None) => {}
            _ => not_restored.push(NotRestored {
                index: *index,
                subindex: *subindex,
                name: entry.map(|entry| dcf.label(entry)).unwrap_or_default(),
                file_text: ObjectValue::new(data.clone(), data_type).text(),
                node_text: found.map(|found| ObjectValue::new(found, data_type).text()),
                error: fault.map(|fault| fault.to_string()),
            }),
        }
    }
    Ok(verified)
}

/// The last download of each object: a PDO is disabled and enabled again.
fn last_values(downloads: &[Download]) -> impl Iterator<Item = &Download> {
    downloads
        .iter()
        .enumerate()
        .filter(|(nth, download)| {
            let key = |download: &Download| (download.index, download.subindex);
            downloads.iter().skip(nth + 1).all(|later| key(later) != key(download))
        })
        .map(|(_, download)| download)
}

fn print(restored: &Restored, output: &Output, out: &mut dyn Write) -> io::Result<()> {
    let Restored { node, file, written, verified, is_stored, not_restored, .. } = restored;
    if !not_restored.is_empty() {
        output::print_with_titles(out, ["OBJECT", "NAME", "FILE", "NODE"], not_restored, |row| {
            let found = match (&row.error, &row.node_text) {
                (Some(error), _) => output.toned(Tone::Bad, error),
                (None, text) => text.clone().unwrap_or_default(),
            };
            [number((row.index, row.subindex)), row.name.clone(), row.file_text.clone(), found]
        })?;
        writeln!(out)?;
    }
    let stored = if *is_stored { ", stored" } else { "" };
    writeln!(
        out,
        "{file} to node {} on can{}: {written} writes, {verified} values verified{stored}",
        node.node, node.channel
    )
}

#[derive(Debug, Args)]
pub struct DiffArguments {
    /// DCF to compare
    file: PathBuf,
    #[command(flatten)]
    target: TargetArguments,
    #[command(flatten)]
    options: FrameOptions,
}

#[derive(Debug, Serialize)]
struct Difference {
    index: u16,
    subindex: u8,
    name: String,
    #[serde(rename = "type")]
    ty: String,
    file: serde_json::Value,
    file_text: String,
    node: Option<serde_json::Value>,
    node_text: Option<String>,
    /// Reason why the value of the node is unknown.
    error: Option<String>,
}

#[derive(Debug, Serialize)]
struct Report {
    #[serde(flatten)]
    node: JsonTarget,
    file: String,
    compared: usize,
    differences: Vec<Difference>,
}

pub fn run_diff(arguments: &DiffArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.options.capture.is_on_output());
    let selected = arguments.target.select(&arguments.options, context)?;
    let dcf = save::read(&arguments.file)?;
    let name = arguments.file.display().to_string();
    let values = save::values(&dcf, selected.target.node);
    let link = start_for(&selected, true, context)?;
    let report = NodeClient::new(link, selected.target, SDO_TIMEOUT).run(|client| {
        save::check(client, &dcf, &name)?;
        let _progress = Progress::show(format!("reading {}", selected.target));
        let mut differences = Vec::new();
        for stored in &values {
            let (index, subindex) = stored.key();
            crate::output::step();
            let found = match client.try_upload(index, subindex)? {
                Ok(data) if stored.is_same(&data) => continue,
                Ok(data) => Ok(ObjectValue::new(data, Some(stored.entry.data_type))),
                Err(fault @ SdoFault::Aborted(_)) => Err(fault.to_string()),
                Err(_) => {
                    // Returns the failure with its remedy.
                    client.upload(index, subindex)?;
                    continue;
                }
            };
            let bytes = stored.entry.data_type.encode(&stored.value).unwrap_or_default();
            let expected = ObjectValue::new(bytes, Some(stored.entry.data_type));
            differences.push(Difference {
                index,
                subindex,
                name: dcf.label(stored.entry),
                ty: stored.entry.data_type.to_string(),
                file: expected.json(),
                file_text: expected.text(),
                node: found.as_ref().ok().map(ObjectValue::json),
                node_text: found.as_ref().ok().map(ObjectValue::text),
                error: found.err(),
            });
        }
        Ok(Report { node: client.json(), file: name, compared: values.len(), differences })
    })?;
    context.output.data(&report, |out| print_differences(&report, &context.output, out))?;
    match report.differences.is_empty() {
        true => Ok(()),
        false => Err(Failure::ProblemsFound),
    }
}

fn print_differences(report: &Report, output: &Output, out: &mut dyn Write) -> io::Result<()> {
    let Report { node, file, compared, differences } = report;
    if !differences.is_empty() {
        output::print_with_titles(out, ["OBJECT", "NAME", "FILE", "NODE"], differences, |row| {
            let found = match (&row.node_text, &row.error) {
                (Some(text), _) => text.clone(),
                (None, error) => output.toned(Tone::Faint, error.as_deref().unwrap_or("unknown")),
            };
            [number((row.index, row.subindex)), row.name.clone(), row.file_text.clone(), found]
        })?;
        writeln!(out)?;
    }
    let count = differences.len();
    let node = format!("node {} on can{}", node.node, node.channel);
    writeln!(out, "{file} and {node}: {compared} values compared, {count} different")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_value_of_each_object_is_verified() {
        let download = |index, data: u8| Download { index, subindex: 1, data: vec![data] };
        let downloads = [download(0x1400, 0x80), download(0x1600, 2), download(0x1400, 0)];
        let last: Vec<_> = last_values(&downloads).cloned().collect();
        assert_eq!(last, [download(0x1600, 2), download(0x1400, 0)]);
    }
}
