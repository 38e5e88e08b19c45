//! The program `ecan-sim`: simulated ECAN-Lite gateways for any EtherCAT master.
//!
//! ```text
//! ecan-sim wire --interface veth1 --gateways 2 --dump can.log
//! ecan-sim firmware --version 2.3.1 --out new.bin
//! ecan-sim variants
//! ```
#![forbid(unsafe_code)]

mod failure;
mod firmware;
mod screen;
mod variants;
mod wire;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use ecan_command_line::logging::LogArguments;

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
    Wire(wire::WireArguments),
    Firmware(firmware::FirmwareArguments),
    Variants(variants::VariantsArguments),
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    arguments.log.start();
    let outcome = match &arguments.command {
        Command::Wire(arguments) => wire::run(arguments),
        Command::Firmware(arguments) => firmware::run(arguments),
        Command::Variants(arguments) => variants::run(arguments),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            screen::Screen::error(&error);
            ExitCode::from(error.status())
        }
    }
}
