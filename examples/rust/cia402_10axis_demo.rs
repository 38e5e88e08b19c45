//! Ten CiA 402 axes on one or more gateways (manual 15.6): startup and load test.
//!
//! ```text
//! cia402_10axis_demo --ecrt sim --slaves 1
//! cia402_10axis_demo --ecrt sim --cycle-us 1000 --dc-sync0 --dc-shift-us 700 --step 20
//! ```

use std::process::ExitCode;

use clap::Parser;
use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::AxisConfig;
use ecan_example_support::motion_demo::{MotionArguments, run_motion};
use ecan_example_support::{EXIT_STATUS, report_exit};
use ecan_protocol::mapping::CHANNELS;
use ecan_tool_support::command_line::screen::parse_arguments;

const NAME: &str = "cia402_10axis_demo";
/// Number of axes.
const AXES: usize = 10;

/// Enable ten CiA 402 axes on the channels of all gateways and move them
#[derive(Debug, Parser)]
#[command(name = NAME, version, after_help = EXIT_STATUS)]
struct Arguments {
    #[command(flatten)]
    motion: MotionArguments,
    /// Number of gateways
    #[arg(long, value_name = "N", default_value_t = 3,
          value_parser = clap::value_parser!(u16).range(1..=10))]
    slaves: u16,
    /// Number of cycles with motion
    #[arg(long, value_name = "N", default_value_t = 1000)]
    cycles: u64,
}

/// Distributes the axes over the channels of all gateways in turn; node-IDs start at 1 on each channel.
fn axis_table(slaves: u16) -> Vec<AxisConfig> {
    let channels = usize::from(slaves) * CHANNELS;
    (0..AXES)
        .map(|axis| {
            let (index, round) = (axis % channels, axis / channels);
            let node = NodeId::new(round as u8 + 1).unwrap_or(NodeId::MIN);
            let (slave, channel) = (index / CHANNELS, (index % CHANNELS) as u8);
            AxisConfig::new(NodeAddress { slave, channel, node })
        })
        .collect()
}

fn main() -> ExitCode {
    let Arguments { motion, slaves, cycles } = parse_arguments();
    report_exit(NAME, run_motion(NAME, &motion, slaves, axis_table(slaves), cycles))
}
