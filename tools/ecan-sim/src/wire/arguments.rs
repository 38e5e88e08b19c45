//! The options of `ecan-sim wire`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use ecan_command_line::real_time::ThreadArguments;
use ecan_sim::ScenarioChoice;

/// Longest run, in seconds: a century.
const LONGEST_RUN_S: f64 = 3.2e9;

/// What stands on the wire, and what is told of it.
#[derive(Debug, Args)]
pub struct WireArguments {
    /// Network interface on which the gateways answer, as one end of a veth pair or a network card
    /// with a cable to the master.
    #[arg(long, short, value_name = "NAME")]
    pub interface: String,
    /// Number of gateways of a built-in scenario [default: 1].
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    pub gateways: Option<u16>,
    /// What is simulated: echo, drives, jitter, or the name of a file that ends in .toml.
    #[arg(long, short, value_name = "SCENARIO", default_value = "echo", value_parser = parse_scenario)]
    pub scenario: ScenarioChoice,
    /// Seed of everything random, in place of the scenario's.
    #[arg(long, value_name = "SEED")]
    pub seed: Option<u64>,
    /// Write the frames of all CAN buses as a candump log; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    pub dump: Option<PathBuf>,
    /// End after so many seconds; otherwise with Ctrl-C or SIGTERM.
    #[arg(long, value_name = "S", value_parser = parse_duration)]
    pub duration: Option<Duration>,
    /// Do not tell what the gateways do.
    #[arg(long, short)]
    pub quiet: bool,
    /// Look for frames all the time instead of sleeping until one comes: takes a whole CPU. Not
    /// with a real-time priority, as Linux stops such a thread for 50 ms in every second.
    #[arg(long, conflicts_with = "rt_priority", help_heading = "Real time")]
    pub spin: bool,
    #[command(flatten)]
    pub thread: ThreadArguments,
}

fn parse_scenario(text: &str) -> Result<ScenarioChoice, String> {
    ScenarioChoice::parse(text).map_err(|error| error.to_string())
}

fn parse_duration(text: &str) -> Result<Duration, String> {
    match text.parse() {
        Ok(seconds) if seconds > 0.0 && seconds < LONGEST_RUN_S => {
            Ok(Duration::from_secs_f64(seconds))
        }
        _ => Err("expected seconds above 0".to_owned()),
    }
}
