//! `ecan config save`, `load` and `factory`: Flash commands (manual 13.7).

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use ecan_host::MaintenanceError;
use ecan_lite::config::{ConfigChecksums, FlashCommand};
use ecan_protocol::device::MaintenanceStatus;
use serde::Serialize;

use crate::config_file;
use crate::context::{Bus, Context, Failure, Output, Result, Tone};
use crate::output::confirm;
use crate::slave_choice::{AllArgument, Recognised};

#[derive(Debug, Args)]
pub struct FlashArguments {
    /// Configuration file that selects the gateways [default: the gateway of the bus]
    #[arg(conflicts_with = "all", value_parser = parse_file)]
    file: Option<PathBuf>,
    #[command(flatten)]
    all: AllArgument,
}

/// A number is meant as a slave, which is an option.
fn parse_file(text: &str) -> Result<PathBuf, String> {
    match text.parse::<u16>() {
        Ok(_) => {
            Err(format!("expected a configuration file; for a file with this name write ./{text}"))
        }
        Err(_) => Ok(text.into()),
    }
}

#[derive(Debug, Serialize)]
struct Done {
    position: usize,
    /// Checksums after the command; `None` if it was not executed.
    active_crc: Option<u32>,
    stored_crc: Option<u32>,
    /// Reason; `None` if another gateway failed before.
    error: Option<String>,
}

pub fn run(
    command: FlashCommand,
    arguments: &FlashArguments,
    is_confirmed: bool,
    context: &Context,
) -> Result {
    let (bus, positions) = gateways(arguments, context)?;
    if command == FlashCommand::Factory {
        let slaves: Vec<_> = positions.iter().map(ToString::to_string).collect();
        let slaves = slaves.join(", ");
        let question = format_args!(
            "Restore the factory configuration of slave {slaves} and erase the saved one?"
        );
        confirm(is_confirmed, "the loss of the configuration", question, "not restored")?;
    }
    let is_list = arguments.all.all || arguments.file.is_some();
    let mut all = Vec::new();
    let mut failed = None;
    for position in positions {
        let mut done = Done { position, active_crc: None, stored_crc: None, error: None };
        if failed.is_none() {
            match command.run(bus.diagnostics(), position, bus.clock()) {
                Ok(ConfigChecksums { active_crc, stored_crc }) => {
                    (done.active_crc, done.stored_crc) = (Some(active_crc), Some(stored_crc));
                }
                Err(error) => {
                    let error = failure(error, position, &bus);
                    done.error = Some(error.to_string());
                    failed = Some(error);
                }
            }
        }
        all.push(done);
    }
    if is_list || failed.is_none() {
        context.output.one_or_list(is_list, &all, |out| {
            all.iter().try_for_each(|done| done.print(command, &context.output, out))
        })?;
    }
    failed.map_or(Ok(()), Err)
}

/// Saves the configuration of one gateway.
pub(super) fn save(bus: &Bus, position: usize) -> Result {
    let saved = FlashCommand::Save.run(bus.diagnostics(), position, bus.clock());
    saved.map(drop).map_err(|error| failure(error, position, bus))
}

fn gateways(arguments: &FlashArguments, context: &Context) -> Result<(Bus, Vec<usize>)> {
    if let Some(path) = &arguments.file {
        let (bus, resolved) = config_file::open_gateways(&config_file::read(path)?, context)?;
        return Ok((bus, resolved.into_iter().map(|resolved| resolved.slave).collect()));
    }
    let bus = context.bus()?;
    let Recognised { gateways, unknown } = bus.one_or_all(arguments.all.all)?;
    match unknown.first() {
        None => Ok((bus, gateways)),
        Some(first) => Err(Failure::Slave(format!("{first}; no gateway was changed"))),
    }
}

fn failure(error: MaintenanceError, position: usize, bus: &Bus) -> Failure {
    let cycle = bus.service().filter(|connection| connection.hello().cycle_ns.is_some());
    match (error, cycle) {
        (MaintenanceError::Device(error), _) => Failure::Device(error),
        (error @ MaintenanceError::Status(MaintenanceStatus::Denied), Some(connection)) => {
            Failure::Rejected(format!(
                "slave {position}: {error}; {} keeps it in OP: end that program, or use a service \
                 without a cycle (ecan serve --idle)",
                connection.program()
            ))
        }
        (other, _) => Failure::Rejected(format!("slave {position}: {other}")),
    }
}

impl Done {
    fn print(
        &self,
        command: FlashCommand,
        output: &Output,
        out: &mut dyn Write,
    ) -> std::io::Result<()> {
        let position = self.position;
        let Some((active, stored)) = self.active_crc.zip(self.stored_crc) else {
            let (tone, message) = match &self.error {
                Some(error) => (Tone::Bad, error.as_str()),
                None => (Tone::Warning, "skipped"),
            };
            return writeln!(out, "slave {position}: {}", output.toned(tone, message));
        };
        let what = match command {
            FlashCommand::Save => "configuration saved in the Flash",
            FlashCommand::Load => "saved configuration loaded",
            FlashCommand::Factory => "factory configuration restored, saved configuration erased",
        };
        writeln!(
            out,
            "slave {position}: {what} (CRC32 active 0x{active:08X}, stored 0x{stored:08X})"
        )
    }
}
