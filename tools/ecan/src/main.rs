//! The program `ecan`: bring-up, diagnosis and maintenance of ECAN-Lite gateways.
//!
//! ```text
//! ecan --ecrt sim scan
//! ecan --slave 0 sdo read 0x8010:3
//! ```
#![forbid(unsafe_code)]

mod bus;
mod commands;
mod config_file;
mod confirmation;
mod ethercat_tool;
mod failure;
mod firmware_version;
mod frames;
mod global;
mod object_path;
mod output;
mod program;
mod readings;
mod slave_choice;
mod table;
mod value;

use std::process::ExitCode;

use clap::{CommandFactory, Parser};

use commands::Command;
use failure::Failure;
use global::GlobalOptions;
use output::Output;

/// Bring-up, diagnosis and maintenance of ECAN-Lite gateways.
#[derive(Debug, Parser)]
#[command(name = "ecan", version, after_help = global::EXIT_STATUS)]
struct Arguments {
    #[command(flatten)]
    global: GlobalOptions,
    #[command(subcommand)]
    command: Command,
}

fn main() -> ExitCode {
    let Arguments { global, command } = Arguments::parse();
    global.log.start();
    let output = Output::new(global.json, global.color);
    let outcome = match &command {
        Command::Scan => commands::scan::run(&global, &output),
        Command::Info(arguments) => commands::info::run(arguments, &global, &output),
        Command::Caps => commands::caps::run(&global, &output),
        Command::Config(arguments) => commands::config::run(arguments, &global, &output),
        Command::Sdo(arguments) => commands::sdo::run(arguments, &global, &output),
        Command::Diag(arguments) => commands::diag::run(arguments, &global, &output),
        Command::Doctor(arguments) => commands::doctor::run(arguments, &global, &output),
        Command::Reg(arguments) => commands::reg::run(arguments, &global, &output),
        Command::Filter(arguments) => commands::filter::run(arguments, &global, &output),
        Command::Pins(arguments) => commands::pins::run(arguments, &global, &output),
        Command::Reboot(arguments) => commands::reboot::run(arguments, &global, &output),
        Command::Plan(arguments) => commands::plan::run(arguments, &output),
        Command::Firmware(arguments) => commands::firmware::run(arguments, &global, &output),
        Command::Dump(arguments) => commands::dump::run(arguments, &global, &output),
        Command::Send(arguments) => commands::send::run(arguments, &global, &output),
        Command::Gen(arguments) => commands::generate::run(arguments, &global, &output),
        Command::Replay(arguments) => commands::replay::run(arguments, &global, &output),
        Command::Monitor(arguments) => commands::monitor::run(arguments, &global, &output),
        Command::Bridge(arguments) => commands::bridge::run(arguments, &global, &output),
        Command::Selftest(arguments) => commands::selftest::run(arguments, &global, &output),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut Arguments::command(), "ecan", &mut script);
            output.bytes(&script)
        }
        Command::Man { directory } => commands::man::run(&Arguments::command(), directory, &output),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::ReaderGone) => ExitCode::SUCCESS,
        Err(failure) => {
            output.failure(&failure);
            ExitCode::from(failure.status())
        }
    }
}
