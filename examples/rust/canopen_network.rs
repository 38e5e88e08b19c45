//! A CANopen network from files (CiA 302-2): boots the nodes and enables the axes of a configuration
//! file, moves the axes by their target steps, and stops them.
//!
//! ```text
//! canopen_network examples/network/machine.toml --ecrt sim:examples/network/simulated.toml
//! ```

use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use ecan_canopen::{BootPhase, BootState};
use ecan_cia402::Cia402;
use ecan_example_support::MasterArguments;
use ecan_example_support::{EXIT_STATUS, Interrupt, report_exit, wait_ready};
use ecan_mcan_port::Port;
use ecan_tool_support::command_line::screen::parse_arguments;
use ecan_tool_support::print_line;

/// Longest time of the boot-up and of each step of the startup.
const STARTUP: Duration = Duration::from_secs(30);
const SHUTDOWN: Duration = Duration::from_secs(20);

/// Boot the CANopen nodes and move the axes of a configuration file
#[derive(Debug, Parser)]
#[command(name = "canopen_network", version, after_help = EXIT_STATUS)]
struct Arguments {
    /// Configuration file with `[[node]]` tables
    file: PathBuf,
    /// Number of cycles with motion
    #[arg(long, value_name = "N", default_value_t = 1000)]
    cycles: u64,
    #[command(flatten)]
    master: MasterArguments,
}

fn main() -> ExitCode {
    report_exit("canopen_network", run(&parse_arguments()))
}

/// Runs the network. Returns whether all axes followed their targets until the end.
fn run(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    let path = &arguments.file;
    let (config, axes) = (ecan_lite::config::load(path)?, ecan_lite::config::load_axes(path)?);
    let nodes = ecan_lite::config::load_nodes(path)?;
    let settings = ecan_lite::config::load_network_settings(path)?;
    let interrupt = Interrupt::install()?;
    let backend = arguments.master.open("drives", ecan_lite::config::load_ecrt_options(path)?)?;
    let mut port = Port::open(&backend.ecrt, (config.adapter, config.port))?;
    if !wait_ready(&mut port, &interrupt)? {
        return Ok(true);
    }
    let node_config = settings.cia402.node;
    let time = settings.time(port.adapter().clock().now_ns());
    let mut cia402 = Cia402::new(&port, axes, settings.cia402)?;
    cia402.network_mut().set_time(time)?;
    for node in &nodes {
        let network = cia402.network_mut();
        let handle = network.add_node(node.address, node_config)?;
        network.boot(handle, node.boot_config()?);
    }
    print_line!("{} nodes, {} axes", nodes.len(), cia402.axis_count());

    let moved = boot_nodes(&mut port, &mut cia402, &interrupt)
        .and_then(|()| move_axes(&mut port, &mut cia402, arguments.cycles, &interrupt));
    let was_running = moved.is_ok() && (cia402.axis_count() == 0 || cia402.all_running());
    // Stops and disables the drives, also after an error.
    let shutdown = cia402.blocking(&mut port, SHUTDOWN).shut_down();
    moved?;
    shutdown?;
    print_line!("stopped");
    Ok(was_running || interrupt.is_set())
}

/// Waits until all mandatory nodes are booted, and prints each change of their phases.
fn boot_nodes(
    port: &mut Port,
    cia402: &mut Cia402,
    interrupt: &Interrupt,
) -> Result<(), Box<dyn Error>> {
    let deadline = port.adapter().clock().now_ns().saturating_add(STARTUP.as_nanos() as u64);
    let mut phases: Vec<BootPhase> = Vec::new();
    loop {
        let mut cycle = port.next_cycle();
        let now = cycle.adapter().clock().now_ns();
        cia402.process_rx(&mut cycle);
        cia402.send_targets_all(&mut cycle);
        cycle.end()?;
        for (nth, node) in cia402.network().boot_progress(now).enumerate() {
            if phases.get(nth) != Some(&node.phase) {
                phases.resize(phases.len().max(nth + 1), BootPhase::Waiting);
                phases[nth] = node.phase;
                print_line!("{node}");
            }
        }
        match cia402.network().boot_state() {
            BootState::Booted => return Ok(()),
            BootState::Failed => return Err("a mandatory node failed, see above".into()),
            BootState::Running if now > deadline => return Err("the boot-up takes too long".into()),
            BootState::Running if interrupt.is_set() => return Err("stopped by the user".into()),
            BootState::Running => {}
        }
    }
}

/// Configures and enables the axes, then moves them; nodes that restart are booted again.
fn move_axes(
    port: &mut Port,
    cia402: &mut Cia402,
    cycles: u64,
    interrupt: &Interrupt,
) -> Result<(), Box<dyn Error>> {
    cia402.blocking(port, STARTUP).on_progress(|axis| print_line!("{axis}")).start_up()?;
    for _ in 0..cycles {
        let mut cycle = port.next_cycle();
        cia402.process_rx(&mut cycle);
        cia402.send_target_step(&mut cycle);
        cycle.end()?;
        if interrupt.is_set() {
            break;
        }
    }
    for axis in cia402.axes() {
        let position =
            axis.actual().map_or_else(|| "unknown".to_owned(), |steps| steps.to_string());
        print_line!("axis {}: actual position {position}", axis.index());
    }
    Ok(())
}
