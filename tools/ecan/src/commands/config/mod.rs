//! `ecan config`: configuration file of the gateways.

mod apply;
mod check;
mod export;
mod flash;
mod replace;

use std::path::PathBuf;

use clap::{Args, Subcommand};
use ecan_lite::config::{EXAMPLE, FlashCommand, INIT};

use crate::context::{Context, Result};

#[derive(Debug, Args)]
#[command(after_help = "\
First configuration, from the file to the Flash of the gateway:
  ecan config init > cell.toml         # one gateway; `example` prints every key, with comments
  ecan config check cell.toml          # faults, bit timing, Message RAM, sizes
  ecan config apply cell.toml          # in PREOP, with readback
  ecan config diff cell.toml && ecan config save cell.toml
  ecan config export cell.toml --format twincat > startup.xml

The file selects the master, unless --master is given. --slave selects one gateway of the file.")]
pub struct ConfigArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Print a first file: one gateway, one channel
    Init,
    /// Print a commented file with every key
    Example,
    /// Print the JSON schema of the file, for editors
    Schema,
    /// Check a file offline: print all faults, or the derived settings
    ///
    /// Bit timings are computed for the default MCAN clock of 80 MHz.
    Check {
        /// Configuration file
        file: PathBuf,
    },
    /// Write a file to the gateways in PREOP, in the order of the manual (5.4.3)
    Apply {
        /// Configuration file
        file: PathBuf,
        /// Print every step
        #[arg(long)]
        steps: bool,
    },
    /// Compare the gateways with a file; exit status 1 if they differ
    Diff {
        /// Configuration file
        file: PathBuf,
        /// Include objects that the master writes at each start: PDO assignment, active profiles
        #[arg(long)]
        active: bool,
    },
    /// Save the configuration of a gateway to its Flash (13.7)
    Save(flash::FlashArguments),
    /// Load the saved configuration
    Load(flash::FlashArguments),
    /// Restore the factory configuration and erase the saved one, after confirmation
    Factory {
        #[command(flatten)]
        whose: flash::FlashArguments,
        /// Do not ask for confirmation
        #[arg(long)]
        yes: bool,
    },
    /// Give a new gateway the place of a broken one: alias, configuration, log
    Replace(replace::ReplaceArguments),
    /// Print the startup list for another EtherCAT master (5.4.3, 5.4.5)
    Export(export::ExportArguments),
}

pub fn run(arguments: &ConfigArguments, context: &Context) -> Result {
    match &arguments.action {
        Action::Init => context.output.bytes(INIT.as_bytes()),
        Action::Example => context.output.bytes(EXAMPLE.as_bytes()),
        Action::Schema => context.output.bytes(ecan_lite::config::schema().as_bytes()),
        Action::Check { file } => {
            context.global.without_slave("the whole file is checked offline")?;
            check::run(file, &context.output)
        }
        Action::Apply { file, steps } => apply::run(file, *steps, context),
        Action::Diff { file, active } => export::compare(file, *active, context),
        Action::Save(whose) => flash::run(FlashCommand::Save, whose, true, context),
        Action::Load(whose) => flash::run(FlashCommand::Load, whose, true, context),
        Action::Factory { whose, yes } => flash::run(FlashCommand::Factory, whose, *yes, context),
        Action::Replace(arguments) => replace::run(arguments, context),
        Action::Export(arguments) => export::export_steps(arguments, context),
    }
}
