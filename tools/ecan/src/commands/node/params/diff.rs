//! `ecan node params diff`.

use std::io::{self, Write};
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use ecan_canopen::SdoFault;
use serde::Serialize;

use crate::commands::node::node_client::{NodeClient, start_for};
use crate::commands::node::node_target::{JsonTarget, TargetArguments};
use crate::commands::node::object_names::number;
use crate::commands::node::object_value::ObjectValue;
use crate::context::{Context, Failure, Output, Result, Tone};
use crate::frames::FrameOptions;
use crate::progress::Progress;
use crate::table;

use super::{dcf_file, identity};

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

const SDO_TIMEOUT: Duration = Duration::from_millis(500);

pub fn run(arguments: &DiffArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.options.capture.is_on_output());
    let selected = arguments.target.select(&arguments.options, context)?;
    let dcf = dcf_file::read(&arguments.file)?;
    let name = arguments.file.display().to_string();
    let values = dcf_file::values(&dcf, selected.target.node);
    let link = start_for(&selected, true, context)?;
    let report = NodeClient::new(link, selected.target, SDO_TIMEOUT).run(|client| {
        identity::check(client, &dcf, &name)?;
        let _progress = Progress::show(format!("reading {}", selected.target));
        let mut differences = Vec::new();
        for stored in &values {
            let (index, subindex) = stored.key();
            crate::progress::step();
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
    context.output.data(&report, |out| print(&report, &context.output, out))?;
    match report.differences.is_empty() {
        true => Ok(()),
        false => Err(Failure::ProblemsFound),
    }
}

fn print(report: &Report, output: &Output, out: &mut dyn Write) -> io::Result<()> {
    let Report { node, file, compared, differences } = report;
    if !differences.is_empty() {
        table::print_with_titles(out, ["OBJECT", "NAME", "FILE", "NODE"], differences, |it| {
            let found = match (&it.node_text, &it.error) {
                (Some(text), _) => text.clone(),
                (None, error) => output.toned(Tone::Faint, error.as_deref().unwrap_or("unknown")),
            };
            [number((it.index, it.subindex)), it.name.clone(), it.file_text.clone(), found]
        })?;
        writeln!(out)?;
    }
    let count = differences.len();
    let node = format!("node {} on can{}", node.node, node.channel);
    writeln!(out, "{file} and {node}: {compared} values compared, {count} different")
}
