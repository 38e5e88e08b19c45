//! The program `ecan-sim`: simulated ECAN-Lite gateways for any EtherCAT master.
//!
//! ```text
//! ecan-sim wire --interface veth1 --gateways 2 --dump can.log
//! ecan-sim firmware --version 2.3.1 --out new.bin
//! ecan-sim variants
//! ```
#![forbid(unsafe_code)]

mod failure;
mod frame_prediction;
mod offline;
mod packet_socket;
mod report;
mod server;
mod wire;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use clap_complete::Shell;
use ecan_tool_support::command_line::options::LogArguments;
use ecan_tool_support::command_line::screen::parse_arguments;

/// Simulated ECAN-Lite gateways for any EtherCAT master.
#[derive(Debug, Parser)]
#[command(name = "ecan-sim", version, after_help = failure::EXIT_STATUS)]
struct Arguments {
    #[command(flatten)]
    log: LogArguments,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Simulate gateways on a network interface for any EtherCAT master.
    Wire(server::WireArguments),
    Firmware(offline::FirmwareArguments),
    Variants(offline::VariantsArguments),
    /// Print a completion script for a shell
    Completions {
        /// Shell
        shell: Shell,
    },
    /// Write the manual pages
    Man {
        /// Directory for the pages
        directory: PathBuf,
    },
}

fn main() -> ExitCode {
    let arguments: Arguments = parse_arguments();
    arguments.log.start();
    let outcome = match &arguments.command {
        Command::Wire(arguments) => wire::run(arguments),
        Command::Firmware(arguments) => offline::write_firmware(arguments),
        Command::Variants(arguments) => offline::list_variants(arguments),
        Command::Completions { shell } => offline::print_completions(Arguments::command(), *shell),
        Command::Man { directory } => offline::write_manual_pages(Arguments::command(), directory),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            failure::Screen::error(&error);
            ExitCode::from(error.status())
        }
    }
}
