//! The program `ecan-soak`: random machines, traffic, faults and actions on the simulator, checked after every cycle
//! by what the simulator knows.
//!
//! ```text
//! ecan-soak --seeds 100 --cycles 10000
//! ecan-soak --replay soak-17.toml
//! ```
#![deny(unsafe_code)]

mod account;
mod application;
mod c_application;
mod channel;
mod draw;
mod drives;
mod event;
mod finding;
mod firmware_update;
mod frame_number;
mod machine;
mod master_owner;
mod plan;
mod runner;
mod seen;
mod service_client;
mod service_clients;
mod service_plan;
mod shrink;
mod side;
mod talker;
mod trial;
mod upkeep;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::screen::parse_arguments;
use ecan_tool_support::print_error_line;

/// Random simulated machines, checked after every cycle.
///
/// Each seed decides a machine, its traffic, faults and actions. A violation ends its trial; the smallest plan that
/// repeats it is written to a file.
#[derive(Debug, Parser)]
#[command(
    name = "ecan-soak",
    version,
    after_help = "Exit status: 0 without a finding, 1 with one, 2 for a usage error"
)]
struct Arguments {
    /// First seed
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Number of seeds
    #[arg(long, default_value_t = 1)]
    seeds: u64,
    /// Cycles of each seed with traffic and events
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    cycles: u64,
    /// No further seed is begun after this time, s
    #[arg(long, value_name = "S")]
    seconds: Option<u64>,
    /// Threads [default: one per processor]
    #[arg(long)]
    threads: Option<usize>,
    /// Run the plan of a file
    #[arg(long, value_name = "FILE", conflicts_with_all = ["seed", "seeds", "cycles"])]
    replay: Option<PathBuf>,
    /// Directory for the plans of findings
    #[arg(long, value_name = "DIRECTORY", default_value = ".")]
    output: PathBuf,
    /// Write the plan of the first seed and run nothing
    #[arg(long)]
    plan: bool,
}

fn main() -> ExitCode {
    let arguments: Arguments = parse_arguments();
    let outcome = Interrupt::install_with_message("stopping after the running seeds")
        .map_err(|error| error.to_string())
        .and_then(|interrupt| runner::run(&arguments, &interrupt));
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            print_error_line!("ecan-soak: {error}");
            ExitCode::from(2)
        }
    }
}
