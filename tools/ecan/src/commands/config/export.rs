//! `ecan config export`: startup list for other masters (manual 5.4.3, 5.4.5).

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use ecan_host::StartupStep;
use ecan_lite::config::export::{Format, SlaveAddress, export};
use serde::Serialize;

use crate::config_file;
use crate::context::{Context, Failure, Result};

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
    /// XML of a TwinCAT startup list
    Twincat,
    /// Columns of the CODESYS startup parameters, separated by semicolons
    Codesys,
    /// Shell script with `ethercat download` and checks
    Ethercat,
}

impl From<ListFormat> for Format {
    fn from(format: ListFormat) -> Self {
        match format {
            ListFormat::Csv => Self::Csv,
            ListFormat::Twincat => Self::TwinCat,
            ListFormat::Codesys => Self::Codesys,
            ListFormat::Ethercat => Self::Ethercat,
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

pub fn run(arguments: &ExportArguments, context: &Context) -> Result {
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
    let Some(slave) = slaves.get(gateway) else {
        let message = format!("gateway {gateway} does not exist; the file has {}", slaves.len());
        return Err(Failure::Usage(message));
    };
    let steps = ecan_lite::config::startup(&file, gateway);
    let data: Vec<_> = steps.iter().map(Step::from).collect();
    let (alias, position) = (slave.alias, slave.position);
    let address =
        SlaveAddress { master: config_file::master(&file, context.global), alias, position };
    context.output.data(&data, |out| {
        let list = export(arguments.format.unwrap_or(ListFormat::Csv).into(), &steps, address);
        out.write_all(list.as_bytes())
    })
}
