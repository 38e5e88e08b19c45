use clap::{Args, ValueEnum};
use ecan_tool_support::command_line::options::LogArguments;

use crate::failure::{Failure, Result};
use crate::slave_choice::SlaveChoice;
use crate::via_option::{GivenOptions, Via};

pub const EXIT_STATUS: &str = "\
Exit status:
  0  success, no problems found
  1  problems found (difference, fault, empty bus), not all frames sent, not confirmed, stopped
  2  invalid arguments
  3  no EtherCAT master: library, module, permission or link is missing
  4  no such slave, or several slaves and none selected
  5  slave or node rejected a request or did not respond
  6  file or scenario cannot be read, written or parsed
  7  host denied a resource: real time (--rt-required), thread, socket, address or interface

Without hardware: ecan --ecrt sim scan";

/// When to use colours.
// Not doc comments on the values: they would double the length of every help.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Color {
    #[default]
    Auto,
    Always,
    Never,
}

/// Options of every command.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Bus and output")]
pub struct GlobalOptions {
    /// EtherCAT library: a path, or sim, sim:echo, sim:drives, sim:FILE.toml (simulated)
    /// [default: ECAN_ECRT, or libethercat.so.1]
    #[arg(long, global = true, value_name = "LIBRARY")]
    pub ecrt: Option<String>,
    /// Way to the bus: auto, direct (library), or the socket of a service (ecan serve)
    #[arg(long, global = true, value_name = "WAY", default_value = "auto")]
    pub via: Via,
    /// Index of the EtherCAT master [default: from the configuration file, or 0]
    #[arg(long, global = true, value_name = "N")]
    pub master: Option<u32>,
    /// Slave: position, alias=N or serial=N [default: the only gateway]
    #[arg(long, global = true, value_name = "SLAVE")]
    pub slave: Option<SlaveChoice>,
    /// Print JSON
    #[arg(long, global = true)]
    pub json: bool,
    /// Use colours; auto: on a terminal unless NO_COLOR is set
    #[arg(long, global = true, value_enum, default_value_t = Color::Auto, value_name = "WHEN")]
    pub color: Color,
    #[command(flatten)]
    pub log: LogArguments,
    /// Options of the command, to reject those without effect.
    #[arg(skip)]
    pub given: GivenOptions,
}

impl GlobalOptions {
    /// Rejects `--slave` for a command that does not use it. (clap does not check an option before the
    /// command against those after it.)
    pub fn without_slave(&self, reason: &str) -> Result {
        match self.slave {
            None => Ok(()),
            Some(_) => {
                Err(Failure::Usage(format!("--slave is not used by this command: {reason}")))
            }
        }
    }

    /// Rejects a service for a command that does not use it.
    pub fn without_service(&self, reason: &str) -> Result {
        match self.via {
            Via::Auto | Via::Direct => Ok(()),
            Via::Service(_) => {
                Err(Failure::Usage(format!("this command does not use a service: {reason}")))
            }
        }
    }

    /// The master of a command without a configuration file.
    pub fn master(&self) -> u32 {
        self.master.unwrap_or(0)
    }
}
