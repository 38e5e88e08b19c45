//! A run of the CiA 402 demos.

use std::error::Error;
use std::time::Duration;

use ecan_cia402::{AxisConfig, Cia402, axis_traffic};
use ecan_host::Faults;
use ecan_mcan_port::{Port, PortPlan};
use ecan_tool_support::command_line::screen::{Stream, print};
use ecan_tool_support::plot::Heading;
use ecan_tool_support::print_line;

use crate::motion_arguments::MotionArguments;
use crate::motion_record::MotionRecord;
use crate::{Interrupt, RunInfo, print_plan, run_options, wait_ready};

/// Timeout of configuration and enabling, each, ms.
const STARTUP: Duration = Duration::from_secs(30);
/// Timeout of stopping and disabling, ms.
const SHUTDOWN: Duration = Duration::from_secs(20);

/// Runs axes on these gateways; the name of the program goes into the picture. Returns whether every axis followed its targets until the end.
///
/// # Errors
/// Every error of the bus or of an axis, after the drives were stopped and disabled.
pub fn run_motion(
    program: &str,
    motion: &MotionArguments,
    slaves: u16,
    axes: impl IntoIterator<Item = AxisConfig>,
    cycles: u64,
) -> Result<bool, Box<dyn Error>> {
    let axes = motion.with_step(axes);
    let (adapter, gateways) = motion.gateways(slaves, &axes)?;
    let traffic = axis_traffic(&axes, &motion.cia402());
    if motion.plan {
        print_plan(&adapter, &gateways, &traffic)?;
        return Ok(true);
    }
    // What --plan calls a fault keeps the axes from moving as they should.
    Faults::check(PortPlan::of(&adapter, &gateways, &traffic).faults(&adapter, &gateways))?;
    motion.check_sync0(&adapter, &gateways)?;
    let interrupt = Interrupt::install()?;
    let backend = motion.master.open("drives", &adapter)?;
    motion.thread.apply(|line| print_line!("{line}"))?;
    let mut port = motion.open_port(&backend.ecrt, adapter, gateways)?;
    if !wait_ready(&mut port, &interrupt)? {
        return Ok(true);
    }
    print_line!("{} gateway(s) ready", port.slave_count());
    run_options(&mut port, &motion.thread, motion.master.real_time);

    let mut cia402 = Cia402::new(&port, axes, motion.cia402())?;
    let mut record = MotionRecord::new(&port, &cia402, cycles);
    let moved = move_axes(&mut port, &mut cia402, &mut record, cycles, &interrupt);
    let was_running = moved.is_ok() && cia402.all_running();
    let table = record.table(&cia402);
    if interrupt.is_set() {
        print_line!("stopped by the user");
    }
    // Stops and disables the drives, also after an error.
    print_line!("stopping the axes");
    let shutdown = cia402
        .blocking(&mut port, SHUTDOWN)
        .on_progress(|axis| record.print_progress(axis))
        .shut_down();
    print(Stream::Output, table);
    let heading = Heading::new("Positions and following errors")
        .with_subtitle(motion.setting(slaves))
        .simulated(backend.simulation.is_some())
        .with_run(RunInfo::of_this_run(program, env!("CARGO_PKG_VERSION")));
    record.finish(&port, &cia402, motion.plot.as_deref(), heading)?;
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
    cia402.blocking(port, STARTUP).on_progress(|axis| record.print_progress(axis)).start_up()?;
    record.start_motion(cia402, cycles);
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
