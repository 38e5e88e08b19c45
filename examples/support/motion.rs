//! What the CiA 402 demos share: from their options to axes that move, and to the table at the
//! end (manual 15.6).

use std::collections::HashMap;
use std::error::Error;
use std::path::PathBuf;

use clap::Args;
use ecan_cia402::{AxisConfig, AxisProgress, Cia402, Cia402Config, LoadWarning, axis_traffic};
use ecan_host::{AdapterConfig, ClockSource, DcSync};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig, Traffic};
use ecan_protocol::image::{EncapsulationProfile, OptionFlags};
use ecan_protocol::mapping::CHANNELS;

use crate::backend::{self, SimulationDefaults};
use crate::interrupt::Interrupt;
use crate::motion_table;
use crate::open::{Configure, open};
use crate::plan;
use crate::plot::Plot;
use crate::progress;
use crate::real_time::{self, RealTimeArguments};

/// How long drives may take to be configured, found and enabled, each, in milliseconds.
const START_UP_MS: u32 = 30_000;
/// How long they may take to come to rest and be switched off, in milliseconds.
const SHUTDOWN_MS: u32 = 20_000;
/// Bit rate above which the gateway's CAN channels need CAN FD, which CANopen does not use.
const MAX_BITRATE: u32 = 1_000_000;

/// The options of the manual's table (15.6), and those of all programs here.
#[derive(Debug, Args)]
pub struct MotionArguments {
    /// EtherCAT master library: a path, `sim` for the built-in simulator with drives, `sim:NAME` or
    /// `sim:FILE.toml` for a scenario of it. Unset: the environment variable ECAN_ECRT, then the
    /// installed libethercat.
    #[arg(long, value_name = "SETTING")]
    pub ecrt: Option<String>,
    /// Index of the EtherCAT master.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub master: u32,
    /// PDO size per direction, in chunks of 128 bytes.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub pdo_n: u8,
    /// CAN bit rate in bit/s.
    #[arg(long, value_name = "BITRATE", default_value_t = MAX_BITRATE)]
    pub bitrate: u32,
    /// EtherCAT cycle in microseconds.
    #[arg(long, value_name = "US", default_value_t = 10_000)]
    pub cycle_us: u32,
    /// Step of every axis per target, in increments; 0 enables without moving.
    #[arg(long, value_name = "STEP", default_value_t = 0, allow_negative_numbers = true)]
    pub step: i32,
    /// Cycles from target to target.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub motion_div: u32,
    /// PDO packet profile: 0, 1, 4 or 5.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub profile: u8,
    /// Align packets to 4 bytes.
    #[arg(long)]
    pub align4: bool,
    /// Leave the gateways' startup SDOs out, for repeated debugging: they must be configured
    /// already.
    #[arg(long)]
    pub skip_sdo_config: bool,
    /// Use distributed clocks with Sync0.
    #[arg(long)]
    pub dc_sync0: bool,
    /// Period of Sync0 in microseconds [default: the cycle].
    #[arg(long, value_name = "US")]
    pub dc_cycle_us: Option<u32>,
    /// Let the cycle follow the slaves' reference clock, instead of the other way round.
    #[arg(long, requires = "dc_sync0")]
    pub dc_follow: bool,
    /// Shift of Sync0 in microseconds.
    #[arg(long, value_name = "US", default_value_t = 0)]
    pub dc_shift_us: u32,
    /// Print what the configuration costs, with what speaks against it, and end; touches no bus.
    #[arg(long)]
    pub plan: bool,
    /// Draw target and actual position of every axis.
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    #[command(flatten)]
    thread: RealTimeArguments,
    /// Seed of everything random in a simulation.
    #[arg(long, value_name = "SEED")]
    pub seed: Option<u64>,
    /// Run a simulation in wall-clock time instead of as fast as the machine goes.
    #[arg(long)]
    pub real_time: bool,
}

/// Gateways and cycles of a demo.
#[derive(Debug, Clone, Copy)]
pub struct Extent {
    /// Number of gateways.
    pub slaves: u16,
    /// Cycles to move in.
    pub cycles: u64,
}

fn configuration(
    arguments: &MotionArguments,
    extent: Extent,
    axes: &[AxisConfig],
) -> Result<(AdapterConfig, PortConfig), Box<dyn Error>> {
    let mut adapter = AdapterConfig::new(extent.slaves)
        .with_multiplier(arguments.pdo_n)
        .with_cycle_us(arguments.cycle_us);
    adapter.master_index = arguments.master;
    if arguments.dc_sync0 {
        let sync0_us = arguments.dc_cycle_us.unwrap_or(arguments.cycle_us);
        let ns = |us: u32| us.saturating_mul(1_000);
        let source = if arguments.dc_follow { ClockSource::Reference } else { ClockSource::Host };
        adapter.dc =
            Some(DcSync { source, ..DcSync::new(ns(sync0_us), ns(arguments.dc_shift_us)) });
    }
    let profile = EncapsulationProfile::from_raw(arguments.profile)
        .ok_or_else(|| format!("--profile {} is not one of 0, 1, 4, 5", arguments.profile))?;
    let options = if arguments.align4 { OptionFlags::ALIGN4 } else { OptionFlags::default() };
    let mut gateways = vec![GatewayConfig::default(); usize::from(extent.slaves)];
    for (slave, gateway) in gateways.iter_mut().enumerate() {
        (gateway.tx_encapsulation, gateway.rx_encapsulation) = (profile, profile);
        (gateway.tx_options, gateway.rx_options) = (options, options);
        for channel in 0..CHANNELS {
            let here = |axis: &&AxisConfig| {
                axis.address.slave == slave && usize::from(axis.address.channel) == channel
            };
            if axes.iter().filter(here).count() > 0 {
                let settings = ChannelConfig::classic(arguments.bitrate);
                gateway.channels[channel] = Some(settings.with_traffic(Traffic::default()));
            }
        }
    }
    Ok((adapter, PortConfig { gateways }))
}

/// Opens the gateways and brings them into service; `None` when the user gave up.
fn open_port(
    arguments: &MotionArguments,
    extent: Extent,
    axes: &[AxisConfig],
    interrupt: &Interrupt,
) -> Result<Option<Port>, Box<dyn Error>> {
    let (adapter, config) = configuration(arguments, extent, axes)?;
    let backend = backend::open(
        arguments.ecrt.as_deref(),
        SimulationDefaults {
            scenario: "drives",
            slaves: usize::from(extent.slaves),
            seed: arguments.seed,
            real_time: arguments.real_time,
            large_pdos: false,
        },
    )?;
    let configure = if arguments.skip_sdo_config { Configure::Keep } else { Configure::Write };
    arguments.thread.apply(|line| println!("{line}"))?;
    open(&backend.ecrt, adapter, config, configure, interrupt)
}

/// Prints what an axis is doing whenever that changes.
#[derive(Default)]
struct ProgressPrinter {
    seen: HashMap<usize, String>,
}

impl ProgressPrinter {
    fn tell(&mut self, progress: &AxisProgress) {
        let now = progress.phase.to_string();
        let seen = self.seen.entry(progress.axis).or_default();
        if *seen != now {
            println!("  {progress}");
            *seen = now;
        }
    }
}

fn print_loads(cia402: &Cia402, port: &Port) {
    for load in cia402.bus_load(port) {
        let (slave, channel) = (load.slave, load.channel);
        let percent = |share: f64| share * 100.0;
        print!(
            "slave {slave} can{channel}: {} axes, {} + {} frames per cycle, bus load {:.0} to {:.0} %",
            load.axes,
            load.frames_out,
            load.frames_in,
            percent(load.least),
            percent(load.most)
        );
        println!(
            "{}",
            match load.warning() {
                None => "",
                Some(LoadWarning::TooMuch) => " - too much: lengthen the cycle",
                Some(LoadWarning::Budget) => " - more frames than the gateway serves per cycle",
                Some(LoadWarning::Tight) => " - too much with unlucky data",
                Some(LoadWarning::NoReserve) => " - little is left for SDO and heartbeats",
            }
        );
    }
}

/// Runs a demo; true when every axis was following targets until the end.
///
/// # Errors
/// Anything that keeps the axes from starting.
pub fn run(
    arguments: &MotionArguments,
    extent: Extent,
    axes: Vec<AxisConfig>,
) -> Result<bool, Box<dyn Error>> {
    let axes: Vec<AxisConfig> =
        axes.into_iter().map(|axis| axis.with_target_step(arguments.step)).collect();
    let settings = Cia402Config { motion_div: arguments.motion_div, ..Cia402Config::default() };
    if arguments.plan {
        let (adapter, config) = configuration(arguments, extent, &axes)?;
        plan::print(&adapter, &config, &axis_traffic(&axes, &settings))?;
        return Ok(true);
    }
    let interrupt = Interrupt::install()?;
    let Some(mut port) = open_port(arguments, extent, &axes, &interrupt)? else {
        println!("stopped by the user");
        return Ok(true);
    };
    println!("{} gateway(s) in service", port.slave_count());
    arguments.thread.set_timing(port.adapter_mut());
    if arguments.real_time || arguments.thread.is_given() {
        port.adapter_mut().measure_cycles();
    }
    let mut cia402 = Cia402::new(&port, axes, settings)?;
    print_loads(&cia402, &port);

    let mut narrator = ProgressPrinter::default();
    let mut plot = Plot::new(cia402.axis_count(), extent.cycles);
    let outcome =
        start_and_move(extent.cycles, &mut port, &mut cia402, &mut plot, &mut narrator, &interrupt);
    let was_running = outcome.is_ok() && cia402.all_running();
    let table = motion_table::table(&cia402);

    if interrupt.is_set() {
        println!("stopped by the user");
    }
    println!("coming to rest");
    let shutdown = cia402.shutdown_timeout(&mut port, SHUTDOWN_MS, |axis| narrator.tell(axis));
    print!("{table}");
    if let Some(statistics) = port.adapter().cycle_statistics() {
        real_time::print_statistics(port.adapter(), statistics);
    }
    if let Some(path) = &arguments.plot {
        plot.write(path, &cia402)?;
    }
    outcome?;
    shutdown?;
    Ok(was_running)
}

fn start_and_move(
    cycles: u64,
    port: &mut Port,
    cia402: &mut Cia402,
    plot: &mut Plot,
    narrator: &mut ProgressPrinter,
    interrupt: &Interrupt,
) -> Result<(), Box<dyn Error>> {
    let clock = port.adapter().ecrt().clock().clone();
    let start = clock.now_ns();
    cia402.start_up_timeout(port, START_UP_MS, |axis| narrator.tell(axis))?;
    println!(
        "all axes enabled after {:.2} s, {} cycles of motion",
        (clock.now_ns() - start) as f64 / 1e9,
        cycles
    );
    let progress = progress::bar(cycles);
    let origin = clock.now_ns();
    for cycle in 0..cycles {
        let mut open = port.next_cycle();
        cia402.process_rx(&mut open);
        let summary = cia402.send_target_step(&mut open);
        let result = open.end();
        plot.sample((clock.now_ns() - origin) as f64 / 1e9, cycle, cia402);
        if summary.closed > 0 {
            progress.suspend(|| cia402.progress_all().for_each(|axis| narrator.tell(&axis)));
        }
        progress.set_position(cycle);
        if interrupt.is_set() {
            break;
        }
        result?;
    }
    progress.finish_and_clear();
    Ok(())
}
