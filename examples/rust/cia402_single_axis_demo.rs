//! One CiA 402 axis (manual 15.6): configures it, enables it at its actual position, and moves it
//! step by step.
//!
//! ```text
//! cia402_single_axis_demo --ecrt sim --step 0
//! cia402_single_axis_demo --ecrt sim --step 100 --cycles 2000 --plot axis.svg
//! ```

use std::error::Error;
use std::process::ExitCode;

use clap::Parser;
use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::AxisConfig;
use ecan_example_support::motion_demo::{MotionArguments, run_motion};
use ecan_example_support::{EXIT_STATUS, report_exit};
use ecan_tool_support::command_line::screen::parse_arguments;

const NAME: &str = "cia402_single_axis_demo";

/// Enable one CiA 402 axis and move it by a step per cycle
#[derive(Debug, Parser)]
#[command(name = NAME, version, after_help = EXIT_STATUS)]
struct Arguments {
    #[command(flatten)]
    motion: MotionArguments,
    /// Number of cycles with motion
    #[arg(long, value_name = "N", default_value_t = 20)]
    cycles: u64,
    /// Number of gateways; the drive is on the first one
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u16).range(1..=10))]
    slaves: u16,
    /// CAN channel of the drive
    #[arg(long, value_name = "CHANNEL", default_value_t = 0,
          value_parser = clap::value_parser!(u8).range(0..4))]
    channel: u8,
    /// Node-ID of the drive
    #[arg(long, value_name = "ID", default_value_t = 1,
          value_parser = clap::value_parser!(u8).range(1..=127))]
    node: u8,
}

fn main() -> ExitCode {
    report_exit(NAME, run(&parse_arguments()))
}

/// Runs the demo. Returns whether the axis followed its targets until the end.
fn run(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    let Arguments { motion, cycles, slaves, channel, node } = arguments;
    let node = NodeId::new(*node)?;
    let address = NodeAddress { slave: 0, channel: *channel, node };
    run_motion(NAME, motion, *slaves, [AxisConfig::new(address)], *cycles)
}
