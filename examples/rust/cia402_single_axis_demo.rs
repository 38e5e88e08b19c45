//! One CiA 402 axis behind a gateway (manual 15.6): configures it, enables it where it stands, and
//! moves it step by step.
//!
//! ```text
//! cia402_single_axis_demo --ecrt sim --step 0
//! cia402_single_axis_demo --ecrt sim --step 100 --cycles 2000 --plot axis.svg
//! ```

use std::process::ExitCode;

use clap::Parser;
use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::AxisConfig;
use ecan_example_support::motion::{self, Extent, MotionArguments};

/// Enables one CiA 402 axis and moves it by a step per cycle.
#[derive(Debug, Parser)]
#[command(name = "cia402_single_axis_demo", version)]
struct Arguments {
    #[command(flatten)]
    motion: MotionArguments,
    /// Number of cycles to move in.
    #[arg(long, value_name = "N", default_value_t = 20)]
    cycles: u64,
    /// CAN channel of the drive.
    #[arg(long, value_name = "CHANNEL", default_value_t = 0,
          value_parser = clap::value_parser!(u8).range(0..4))]
    channel: u8,
    /// Node id of the drive.
    #[arg(long, value_name = "ID", default_value_t = 1,
          value_parser = clap::value_parser!(u8).range(1..=127))]
    node: u8,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let node = NodeId::new(arguments.node).unwrap_or(NodeId::MIN);
    let address = NodeAddress { slave: 0, channel: arguments.channel, node };
    let extent = Extent { slaves: 1, cycles: arguments.cycles };
    let outcome = motion::run(&arguments.motion, extent, vec![AxisConfig::new(address)]);
    ecan_example_support::exit::report("cia402_single_axis_demo", outcome)
}
