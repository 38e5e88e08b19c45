//! `ecan config export` and `ecan config diff`: startup list for other masters (manual 5.4.3, 5.4.5), and comparison
//! of the gateways with a file.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use ecan_host::{Expectation, StartupStep};
use ecan_lite::config::export::{Format, ProcessData, SlaveAddress, export};
use ecan_lite::config::{Difference, Expected, ResolvedGateway, differences};
use serde::Serialize;

use crate::commands::serve;
use crate::config_file;
use crate::context::{Context, Failure, Result, Tone, note};
use crate::frames::GatewayRequirements;

#[derive(Debug, Args)]
pub struct ExportArguments {
    /// Configuration file
    file: PathBuf,
    /// Format of the list [default: csv]; not with --json
    #[arg(long, value_enum)]
    format: Option<ListFormat>,
    /// Index of the gateway in the file
    #[arg(long, value_name = "INDEX")]
    gateway: Option<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ListFormat {
    /// Every write and check, one per line
    Csv,
    /// XML of a TwinCAT startup list, with the checks as comments
    Twincat,
    /// Columns of the CODESYS startup parameters, separated by semicolons
    Codesys,
    /// Shell script with `ethercat download` and checks
    Ethercat,
    /// Text: what to enter in the project of a master, and which values to read
    Steps,
}

impl From<ListFormat> for Format {
    fn from(format: ListFormat) -> Self {
        match format {
            ListFormat::Csv => Self::Csv,
            ListFormat::Twincat => Self::TwinCat,
            ListFormat::Codesys => Self::Codesys,
            ListFormat::Ethercat => Self::Ethercat,
            ListFormat::Steps => Self::Steps,
        }
    }
}

#[derive(Debug, Serialize)]
struct Step {
    index: u16,
    subindex: u8,
    is_write: bool,
    bytes: Vec<u8>,
    expected: Option<String>,
}

impl From<&StartupStep> for Step {
    fn from(step: &StartupStep) -> Self {
        let (index, subindex) = step.object();
        let (bytes, expected) = match step {
            StartupStep::Download(write) => {
                let (bytes, length) = write.bytes();
                (bytes.get(..length).unwrap_or_default().to_vec(), None)
            }
            StartupStep::Expect { expected, .. } => (Vec::new(), Some(expected.to_string())),
        };
        Self { index, subindex, is_write: step.is_download(), bytes, expected }
    }
}

pub fn export_steps(arguments: &ExportArguments, context: &Context) -> Result {
    context.global.without_slave("use --gateway to select a gateway of the file")?;
    if context.global.json && arguments.format.is_some() {
        return Err(Failure::Usage("--json and --format exclude each other".to_owned()));
    }
    let file = config_file::read(&arguments.file)?;
    let slaves = &file.adapter.slaves;
    let gateway = match (arguments.gateway, slaves.len()) {
        (Some(gateway), _) => gateway,
        (None, 1) => 0,
        (None, count) => {
            let message = format!("the file has {count} gateways; select one with --gateway");
            return Err(Failure::Usage(message));
        }
    };
    let (Some(slave), Some(process_data)) =
        (slaves.get(gateway), ProcessData::of(&file.adapter, gateway))
    else {
        let message = format!("gateway {gateway} does not exist; the file has {}", slaves.len());
        return Err(Failure::Usage(message));
    };
    let steps = ecan_lite::config::startup(&file, gateway);
    let data: Vec<_> = steps.iter().map(Step::from).collect();
    let (alias, position) = (slave.alias, slave.position);
    let address =
        SlaveAddress { master: config_file::master(&file, context.global), alias, position };
    let format = arguments.format.unwrap_or(ListFormat::Csv);
    context.output.data(&data, |out| {
        let list = export(format.into(), &steps, address, &process_data);
        out.write_all(list.as_bytes())
    })?;
    if matches!(format, ListFormat::Csv | ListFormat::Codesys) {
        note("the project also needs PDO chunks, lengths and clocks: see --format steps");
    }
    Ok(())
}

#[derive(Debug, Serialize)]
struct Compared {
    position: usize,
    gateway: usize,
    /// `None` if not read because this or another gateway failed.
    differences: Option<Vec<Differing>>,
    error: Option<String>,
}

/// A value, or the condition of a readback.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum FileValue {
    Value(u64),
    Condition(String),
}

impl From<Expected> for FileValue {
    fn from(expected: Expected) -> Self {
        match expected {
            Expected::Value(value) => Self::Value(value.into()),
            Expected::Readback(Expectation::Equals(value)) => Self::Value(value),
            Expected::Readback(_) | Expected::Loaded | Expected::NotStated => {
                Self::Condition(expected.to_string())
            }
        }
    }
}

#[derive(Debug, Serialize)]
struct Differing {
    index: u16,
    subindex: u8,
    filter: Option<u8>,
    file: FileValue,
    /// `None` if the device lacks the entry.
    device: Option<u32>,
    is_set_at_start: bool,
    #[serde(skip)]
    words: String,
}

impl From<Difference> for Differing {
    fn from(difference: Difference) -> Self {
        let words = difference.to_string();
        let Difference { index, subindex, filter, expected, found, is_set_at_start } = difference;
        let file = expected.into();
        Self { index, subindex, filter, file, device: found, is_set_at_start, words }
    }
}

pub fn compare(path: &Path, counts_active: bool, context: &Context) -> Result {
    let mut file = config_file::read(path)?;
    let (bus, resolved) = config_file::open_gateways(&file, context)?;
    if bus.service().is_some_and(|connection| serve::keeps_gateways(connection.hello())) {
        let requirements = GatewayRequirements::of_service();
        file.port.gateways.iter_mut().for_each(|gateway| requirements.apply(gateway));
    }
    let mut compared = Vec::new();
    let mut failed = None;
    for ResolvedGateway { gateway, slave: position } in resolved {
        let mut comparison = Compared { position, gateway, differences: None, error: None };
        if failed.is_none() {
            match differences(
                bus.diagnostics(),
                position,
                &ecan_lite::config::startup(&file, gateway),
            ) {
                Ok(found) => {
                    comparison.differences = Some(found.into_iter().map(Differing::from).collect());
                }
                Err(error) => {
                    comparison.error = Some(error.to_string());
                    failed = Some(Failure::Device(error));
                }
            }
        }
        compared.push(comparison);
    }
    let counts = |differing: &&Differing| counts_active || !differing.is_set_at_start;
    context.output.data(&compared, |out| {
        for Compared { position, differences, error, .. } in &compared {
            let Some(differences) = differences else {
                let why = error.as_deref().unwrap_or("skipped");
                let words = context.output.toned(Tone::Bad, format_args!("not compared: {why}"));
                writeln!(out, "slave {position}: {words}")?;
                continue;
            };
            for Differing { words, .. } in differences.iter().filter(counts) {
                writeln!(out, "slave {position}: {}", context.output.toned(Tone::Bad, words))?;
            }
        }
        Ok(())
    })?;
    let all = || compared.iter().filter_map(|compared| compared.differences.as_ref()).flatten();
    let (counted, total) = (all().filter(counts).count(), all().count());
    if total > counted {
        note(format_args!(
            "{} entries that the master writes at each start differ too (shown with --active)",
            total - counted
        ));
    }
    match failed {
        Some(failure) => Err(failure),
        None if counted == 0 => Ok(()),
        None => Err(Failure::ProblemsFound),
    }
}
