use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use ecan_host::MAX_SPIN_NS;
use ecan_tool_support::command_line::options::ThreadArguments;

/// Longest run, in seconds: a century.
const LONGEST_RUN_S: f64 = 3.2e9;

/// Arguments of `ecan-sim wire`.
#[derive(Debug, Args)]
pub struct WireArguments {
    /// Network interface for the gateways, for example one end of a veth pair
    #[arg(long, short, value_name = "NAME")]
    pub interface: String,
    /// Number of gateways of a built-in scenario, 1 to 64 [default: 1]
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    pub gateways: Option<u16>,
    /// Scenario: echo, drives, jitter, or a file name that ends in .toml
    #[arg(long, short, value_name = "SCENARIO", default_value = "echo")]
    pub scenario: String,
    /// Seed of all random values; replaces that of the scenario
    #[arg(long, value_name = "SEED")]
    pub seed: Option<u64>,
    /// Write the frames of all CAN buses to a candump log; `-` is standard output
    #[arg(long, value_name = "FILE")]
    pub dump: Option<PathBuf>,
    /// List all PDOs in the SII of each gateway (categories 50 and 51)
    #[arg(long)]
    pub sii_pdos: bool,
    /// Exit after this time, in s; otherwise on Ctrl-C or SIGTERM
    #[arg(long, value_name = "S", value_parser = parse_duration)]
    pub duration: Option<Duration>,
    /// Do not log gateway events
    #[arg(long, short)]
    pub quiet: bool,
    /// Poll for frames instead of sleeping; uses a whole CPU.
    ///
    /// Not with a real-time priority, because Linux stops such a thread for 50 ms in every second.
    #[arg(long, conflicts_with_all = ["rt_priority", "spin_us"], help_heading = "Real time")]
    pub spin: bool,
    /// Poll for at most this time before each expected frame, in us; 0 only sleeps.
    ///
    /// Applies to masters with a regular cycle, for at most an eighth of it, on a machine with several
    /// CPUs.
    #[arg(long, value_name = "US", default_value_t = 100, help_heading = "Real time",
          value_parser = clap::value_parser!(u64).range(..=MAX_SPIN_NS / 1000))]
    pub spin_us: u64,
    #[command(flatten)]
    pub thread: ThreadArguments,
}

fn parse_duration(text: &str) -> Result<Duration, String> {
    match text.parse() {
        Ok(seconds) if seconds > 0.0 && seconds < LONGEST_RUN_S => {
            Ok(Duration::from_secs_f64(seconds))
        }
        _ => Err("must be above 0".to_owned()),
    }
}
