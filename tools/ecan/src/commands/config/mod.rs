//! `ecan config`: one file describes the gateways.

mod apply;
mod check;
mod diff;
mod export;
mod flash;

use std::path::PathBuf;

use clap::{Args, Subcommand};
use ecan_config_file::{ConfigFile, EXAMPLE, FlashCommand, ResolvedGateway};
use ecan_sim::ClockKind;

use crate::bus::Bus;
use crate::config_file;
use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::Output;

/// The configuration of gateways.
#[derive(Debug, Args)]
#[command(after_help = "\
A first configuration, from the file to the gateway's Flash:
  ecan config example > cell.toml      # every key, with comments
  ecan config check cell.toml          # all faults; bit timing, Message RAM, sizes
  ecan config apply cell.toml          # in PREOP, with each readback checked
  ecan config diff cell.toml && ecan config save cell.toml
  ecan config export cell.toml --format twincat > startup.xml

The master is the file's, unless --master names another. --slave leaves out the other gateways of
the file.")]
pub struct ConfigArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Print a commented file with every key
    Example,
    /// Check a file: all its faults, or what comes out of it; touches no bus
    ///
    /// Bit timings are those at the default MCAN clock of 80 MHz.
    Check {
        /// The file
        file: PathBuf,
    },
    /// Write a file to the gateways in PREOP, in the manual's order (5.4.3)
    Apply {
        /// The file
        file: PathBuf,
        /// Print every step
        #[arg(long)]
        steps: bool,
    },
    /// Compare the gateways with a file, entry by entry; exit status 1 where they differ
    Diff {
        /// The file
        file: PathBuf,
        /// Count also what the master sets up at each start: the PDO assignment, and what is active
        /// of the profiles
        #[arg(long)]
        active: bool,
    },
    /// Save the configuration of a gateway to its Flash (13.7)
    Save(flash::FlashArguments),
    /// Load the saved configuration
    Load(flash::FlashArguments),
    /// Restore the factory's configuration and forget the saved one; asks first
    Factory {
        #[command(flatten)]
        whose: flash::FlashArguments,
        /// Do not ask
        #[arg(long)]
        yes: bool,
    },
    /// Print the startup sequence for another EtherCAT master (5.4.3, 5.4.5)
    Export(export::ExportArguments),
}

pub fn run(
    arguments: &ConfigArguments,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    match &arguments.action {
        Action::Example => output.bytes(EXAMPLE.as_bytes()),
        Action::Check { file } => {
            global.without_slave("the whole file is checked, without a bus")?;
            check::run(file, output)
        }
        Action::Apply { file, steps } => apply::run(file, *steps, global, output),
        Action::Diff { file, active } => diff::run(file, *active, global, output),
        Action::Save(whose) => flash::run(FlashCommand::Save, whose, true, global, output),
        Action::Load(whose) => flash::run(FlashCommand::Load, whose, true, global, output),
        Action::Factory { whose, yes } => {
            flash::run(FlashCommand::Factory, whose, *yes, global, output)
        }
        Action::Export(arguments) => export::run(arguments, global, output),
    }
}

/// The bus that a file is about, with the places of its gateways: all, or the one chosen.
fn places(
    file: &ConfigFile,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(Bus, Vec<ResolvedGateway>), Failure> {
    let bus = config_file::open_bus(file, global, output, ClockKind::Stepped)?;
    let places = config_file::places(file, &bus)?;
    Ok((bus, places))
}
