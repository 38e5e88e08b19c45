//! One CiA 402 axis (manual 15.6): configures it, enables it at its actual position, and moves it
//! step by step.
//!
//! ```text
//! cia402_single_axis_demo --ecrt sim --step 0
//! cia402_single_axis_demo --ecrt sim --step 100 --cycles 2000 --plot axis.svg
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

/// Timeout of configuration and enabling, each, ms.
const STARTUP: Duration = Duration::from_secs(30);
/// Timeout of stopping and disabling, ms.
const SHUTDOWN: Duration = Duration::from_secs(20);

/// Enable one CiA 402 axis and move it by a step per cycle
#[derive(Debug, Parser)]
#[command(name = "cia402_single_axis_demo", version)]
struct Arguments {
    #[command(flatten)]
    motion: MotionArguments,
    /// Number of cycles with motion
    #[arg(long, value_name = "N", default_value_t = 20)]
    cycles: u64,
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
    report_exit("cia402_single_axis_demo", run(&Arguments::parse()))
}

/// Runs the demo. Returns whether every axis followed its targets until the end.
fn run(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    let Arguments { motion, cycles, channel, node } = arguments;
    let node = NodeId::new(*node).ok_or("invalid node-ID")?;
    let address = NodeAddress { slave: 0, channel: *channel, node };
    let axes = motion.with_step([AxisConfig::new(address)]);
    let (adapter, gateways) = motion.gateways(1, &axes)?;
    if motion.plan {
        print_plan(&adapter, &gateways, &axis_traffic(&axes, &motion.cia402()))?;
        return Ok(true);
    }
    let interrupt = Interrupt::install()?;
    let backend = motion.open_backend(1)?;
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
