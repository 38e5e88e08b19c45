//! Ten CiA 402 axes behind one or more gateways (manual 15.6): bring-up and load test.
//!
//! ```text
//! cia402_10axis_demo --ecrt sim --slaves 1
//! cia402_10axis_demo --ecrt sim --cycle-us 1000 --dc-sync0 --dc-shift-us 700 --step 20
//! ```

use std::process::ExitCode;

use clap::Parser;
use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::AxisConfig;
use ecan_example_support::motion::{self, Extent, MotionArguments};
use ecan_protocol::mapping::CHANNELS;

/// Number of axes.
const AXES: usize = 10;

/// Enables ten CiA 402 axes, spread over the channels of all gateways, and moves them by a step per
/// target.
#[derive(Debug, Parser)]
#[command(name = "cia402_10axis_demo", version)]
struct Arguments {
    #[command(flatten)]
    motion: MotionArguments,
    /// Number of gateways.
    #[arg(long, value_name = "N", default_value_t = 3,
          value_parser = clap::value_parser!(u16).range(1..=10))]
    slaves: u16,
    /// Number of cycles to move in.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    cycles: u64,
}

/// Axis by axis to the next channel of all gateways; node ids count up on each channel from 1.
fn axis_table(slaves: u16) -> Vec<AxisConfig> {
    let channels = usize::from(slaves) * CHANNELS;
    (0..AXES)
        .map(|axis| {
            let (place, round) = (axis % channels, axis / channels);
            let node = NodeId::new(round as u8 + 1).unwrap_or(NodeId::MIN);
            let (slave, channel) = (place / CHANNELS, (place % CHANNELS) as u8);
            AxisConfig::new(NodeAddress { slave, channel, node })
        })
        .collect()
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let extent = Extent { slaves: arguments.slaves, cycles: arguments.cycles };
    let outcome = motion::run(&arguments.motion, extent, axis_table(arguments.slaves));
    ecan_example_support::exit::report("cia402_10axis_demo", outcome)
}
