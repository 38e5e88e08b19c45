//! Ten CiA 402 axes on one or more gateways (manual 15.6): startup and load test.
//!
//! ```text
//! cia402_10axis_demo --ecrt sim --slaves 1
//! cia402_10axis_demo --ecrt sim --cycle-us 1000 --dc-sync0 --dc-shift-us 700 --step 20
//! ```

use std::error::Error;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::{AxisConfig, Cia402, axis_traffic};
use ecan_example_support::motion_arguments::MotionArguments;
use ecan_example_support::motion_record::MotionRecord;
use ecan_example_support::{Interrupt, print_plan, report_exit, run_options, wait_ready};
use ecan_mcan_port::Port;
use ecan_protocol::mapping::CHANNELS;

/// Number of axes.
const AXES: usize = 10;
/// Timeout of configuration and enabling, each, ms.
const STARTUP: Duration = Duration::from_secs(30);
/// Timeout of stopping and disabling, ms.
const SHUTDOWN: Duration = Duration::from_secs(20);

/// Enable ten CiA 402 axes on the channels of all gateways and move them
#[derive(Debug, Parser)]
#[command(name = "cia402_10axis_demo", version)]
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
    report_exit("cia402_10axis_demo", run(&Arguments::parse()))
}

/// Runs the demo. Returns whether every axis followed its targets until the end.
fn run(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    let Arguments { motion, slaves, cycles } = arguments;
    let axes = motion.with_step(axis_table(*slaves));
    let (adapter, gateways) = motion.gateways(*slaves, &axes)?;
    if motion.plan {
        print_plan(&adapter, &gateways, &axis_traffic(&axes, &motion.cia402()))?;
        return Ok(true);
    }
    let interrupt = Interrupt::install()?;
    let backend = motion.open_backend(*slaves)?;
    let mut port = motion.open_port(&backend.ecrt, adapter, gateways)?;
    if !wait_ready(&mut port, &interrupt)? {
        println!("stopped by the user");
        return Ok(true);
    }
    println!("{} gateway(s) ready", port.slave_count());
    run_options(&mut port, &motion.thread, motion.real_time);

    let mut cia402 = Cia402::new(&port, axes, motion.cia402())?;
    let mut record = MotionRecord::new(&port, &cia402, *cycles);
    let moved = move_axes(&mut port, &mut cia402, &mut record, *cycles, &interrupt);
    let was_running = moved.is_ok() && cia402.all_running();
    let table = record.table(&cia402);
    if interrupt.is_set() {
        println!("stopped by the user");
    }
    // Stops and disables the drives, also after an error.
    println!("stopping the axes");
    let shutdown = cia402.shutdown_timeout(&mut port, SHUTDOWN, |axis| record.print_progress(axis));
    print!("{table}");
    record.finish(&port, &cia402, motion.plot.as_deref())?;
    moved?;
    shutdown?;
    Ok(was_running)
}

/// Configures and enables the axes at their actual positions, then sends a target per cycle.
fn move_axes(
    port: &mut Port,
    cia402: &mut Cia402,
    record: &mut MotionRecord,
    cycles: u64,
    interrupt: &Interrupt,
) -> Result<(), Box<dyn Error>> {
    cia402.start_up_timeout(port, STARTUP, |axis| record.print_progress(axis))?;
    record.start_motion(cycles);
    for number in 0..cycles {
        let mut cycle = port.next_cycle();
        cia402.process_rx(&mut cycle);
        let sent = cia402.send_target_step(&mut cycle);
        cycle.end()?;
        record.end_cycle(number, cia402, sent.closed > 0);
        if interrupt.is_set() {
            break;
        }
    }
    Ok(())
}
