//! Options that every command has.

use clap::{Args, ValueEnum};
use ecan_command_line::logging::LogArguments;

use crate::failure::Failure;
use crate::slave_choice::SlaveChoice;

/// What the exit status says, for the end of the help.
pub const EXIT_STATUS: &str = "\
Exit status:
  0  done, and nothing amiss
  1  looked, and something is amiss (a difference, a fault)
  2  wrong use of the program
  3  no EtherCAT master: library, module, permission, no link
  4  no such slave, or several and none chosen
  5  a slave refused or did not answer
  6  a file cannot be read, written or understood
  7  this host does not give what was asked for: real time (--rt-required), a thread

Without hardware: ecan --ecrt sim scan";

/// When to use colours.
// Plain comments: a doc comment on a value would spread every help over twice the lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Color {
    // On a terminal, unless NO_COLOR is set.
    #[default]
    Auto,
    Always,
    Never,
}

/// Options of every command.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Bus and output")]
pub struct GlobalOptions {
    /// EtherCAT library: a path, or sim, sim:echo, sim:drives, sim:FILE.toml for a simulated master;
    /// otherwise ECAN_ECRT, otherwise libethercat.so.1
    #[arg(long, global = true, value_name = "LIBRARY")]
    pub ecrt: Option<String>,
    /// Master of the library; otherwise that of the configuration file, otherwise 0
    #[arg(long, global = true, value_name = "N")]
    pub master: Option<u32>,
    /// Slave: its position, alias=N or serial=N; needed only where there are several gateways
    #[arg(long, global = true, value_name = "SLAVE")]
    pub slave: Option<SlaveChoice>,
    /// Print JSON
    #[arg(long, global = true)]
    pub json: bool,
    /// Colours; auto: on a terminal, unless NO_COLOR is set
    #[arg(long, global = true, value_enum, default_value_t = Color::Auto, value_name = "WHEN")]
    pub color: Color,
    #[command(flatten)]
    pub log: LogArguments,
}

impl GlobalOptions {
    /// Refuses `--slave`, which the command would not obey. (clap does not hold an option in front
    /// of a command against those behind it.)
    ///
    /// # Errors
    /// [`Failure::Usage`] with what the command is about instead.
    pub fn without_slave(&self, instead: &str) -> Result<(), Failure> {
        match self.slave {
            None => Ok(()),
            Some(_) => Err(Failure::Usage(format!("--slave means nothing here: {instead}"))),
        }
    }

    /// The master of a command without a configuration file.
    pub fn master(&self) -> u32 {
        self.master.unwrap_or(0)
    }
}
