//! A run of the CiA 402 demos, with their options and configuration (manual 15.6).

use std::error::Error;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use ecan_cia402::{AxisConfig, Cia402, Cia402Config, axis_traffic};
use ecan_host::{Adapter, AdapterConfig, ClockSource, DcSync, Ecrt, Faults, StartupPlan};
use ecan_lite::EcrtOptions;
use ecan_mcan_port::{BusWatch, ChannelConfig, GatewayConfig, Port, PortConfig, PortPlan, Traffic};
use ecan_protocol::image::{EncapsulationProfile, OptionFlags};
use ecan_protocol::mapping::CHANNELS;
use ecan_tool_support::command_line::options::{parse_bit_rate, parse_svg_path};
use ecan_tool_support::command_line::screen::{Stream, print};
use ecan_tool_support::plot;
use ecan_tool_support::plot::Heading;
use ecan_tool_support::{print_error_line, print_line};

use crate::motion_record::MotionRecord;
use crate::program::MasterArguments;
use crate::real_time::RealTimeArguments;
use crate::sync0::{print_sync0, sync0};
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
    // A file that cannot be written is reported before the axes move.
    plot::check_file(motion.plot.as_deref())?;
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
    let backend = motion.master.open("drives", EcrtOptions::for_axes(&adapter, &axes))?;
    motion.thread.apply(|line| print_line!("{line}"))?;
    let mut port = motion.open_port(&backend.ecrt, adapter, gateways)?;
    if !wait_ready(&mut port, &interrupt)? {
        return Ok(true);
    }
    print_line!("{} gateway(s) ready", port.slave_count());
    run_options(&mut port, &motion.thread, motion.master.real_time);

    let mut cia402 = Cia402::new(&port, axes, motion.cia402())?;
    let mut record = MotionRecord::new(&port, &cia402, cycles);
    let mut watch = BusWatch::new(&port);
    let moved = move_axes((&mut port, &mut watch), &mut cia402, &mut record, cycles, &interrupt);
    let was_running = moved.is_ok() && cia402.all_running();
    record.end_motion(&cia402);
    if interrupt.is_set() {
        print_line!("stopped by the user");
    }
    // Stops and disables the drives, also after an error.
    print_line!("stopping the axes");
    let shutdown = cia402
        .blocking(&mut port, SHUTDOWN)
        .on_progress(|axis| record.on_shutdown(axis))
        .on_bus_change(&mut watch, |change| print_line!("{change}"))
        .shut_down();
    print(Stream::Output, record.table(&cia402));
    let heading = Heading::new("Positions and following errors")
        .with_subtitle(motion.setting(slaves))
        .simulated(backend.simulation.is_some())
        .with_run(RunInfo::of_this_run(program, env!("CARGO_PKG_VERSION")));
    let drawn = record.finish(&port, &cia402, motion.plot.as_deref(), heading);
    let result = moved.and_then(|()| Ok(shutdown?));
    match (result, drawn) {
        (Ok(()), drawn) => drawn.map(|()| was_running).map_err(Into::into),
        (Err(error), drawn) => {
            // The error of the motion decides on the exit status.
            if let Err(drawn) = drawn {
                print_error_line!("{program}: {drawn}");
            }
            Err(error)
        }
    }
}

/// Configures and enables the axes at their actual positions, then sends a target per cycle.
fn move_axes(
    (port, watch): (&mut Port, &mut BusWatch),
    cia402: &mut Cia402,
    record: &mut MotionRecord,
    cycles: u64,
    interrupt: &Interrupt,
) -> Result<(), Box<dyn Error>> {
    cia402
        .blocking(port, STARTUP)
        .on_progress(|axis| record.print_progress(axis))
        .on_bus_change(watch, |change| print_line!("{change}"))
        .start_up()?;
    record.start_motion(cia402, cycles);
    for number in 0..cycles {
        let mut cycle = port.next_cycle();
        cia402.process_rx(&mut cycle);
        let sent = cia402.send_target_step(&mut cycle);
        cycle.end()?;
        record.end_cycle(number, watch.changes(port), cia402, sent.closed > 0);
        if interrupt.is_set() {
            break;
        }
    }
    Ok(())
}

/// Options of the motion demos: those of manual 15.6 and the common ones.
#[derive(Debug, Args)]
pub struct MotionArguments {
    /// Options of the master
    #[command(flatten)]
    pub master: MasterArguments,
    /// PDO size per direction, in chunks of 128 bytes
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub pdo_n: u8,
    /// Allow PDOs above 1486 bytes: the master must split them into datagrams
    #[arg(long)]
    pub large_pdos: bool,
    /// CAN bit rate in bit/s, or 500k, 1M: the maximum of classic CAN, which CANopen uses
    #[arg(long, value_name = "BITRATE", default_value = "1M", value_parser = parse_bit_rate)]
    pub bitrate: u32,
    /// EtherCAT cycle
    #[arg(long, value_name = "US", default_value_t = 10_000)]
    pub cycle_us: u32,
    /// Step of every axis per target, in increments; 0 enables without motion
    #[arg(long, value_name = "STEP", default_value_t = 0, allow_negative_numbers = true)]
    pub step: i32,
    /// Cycles per target
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub motion_div: u32,
    /// PDO packet profile: 0, 1, 4 or 5
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub profile: u8,
    /// Align packets to 4 bytes
    #[arg(long)]
    pub align4: bool,
    /// Skip the startup SDOs; the gateways must be configured already
    #[arg(long)]
    pub skip_sdo_config: bool,
    /// Use distributed clocks with Sync0
    #[arg(long)]
    pub dc_sync0: bool,
    /// Period of Sync0 [default: the cycle]
    #[arg(long, value_name = "US")]
    pub dc_cycle_us: Option<u32>,
    /// Synchronise the cycle to the reference clock of the slaves, not the slaves to the cycle
    #[arg(long, requires = "dc_sync0")]
    pub dc_follow: bool,
    /// Shift of Sync0 [default: the middle of the usable ones, by the plan]
    #[arg(long, value_name = "US")]
    pub dc_shift_us: Option<u32>,
    /// Accept a shift among the arrivals of the plan: it was measured on this machine
    #[arg(long, requires = "dc_shift_us")]
    pub dc_shift_measured: bool,
    /// Print the plan with its warnings and exit, without a bus
    #[arg(long)]
    pub plan: bool,
    /// Write a picture of the target and actual positions
    #[arg(long, value_name = "FILE.svg", value_parser = parse_svg_path)]
    pub plot: Option<PathBuf>,
    /// Options of the real-time thread
    #[command(flatten)]
    pub thread: RealTimeArguments,
}

impl MotionArguments {
    /// Axes with the step of the options.
    pub fn with_step(&self, axes: impl IntoIterator<Item = AxisConfig>) -> Vec<AxisConfig> {
        axes.into_iter().map(|axis| axis.with_target_step(self.step)).collect()
    }

    /// Configuration of the axes' context.
    pub fn cia402(&self) -> Cia402Config {
        Cia402Config { motion_div: self.motion_div, ..Cia402Config::default() }
    }

    /// Configuration of the gateways: the channels of the axes are enabled.
    ///
    /// # Errors
    /// The packet profile is invalid.
    pub fn gateways(
        &self,
        slaves: u16,
        axes: &[AxisConfig],
    ) -> Result<(AdapterConfig, PortConfig), Box<dyn Error>> {
        let mut adapter = self.master.adapter(slaves, self.pdo_n, self.cycle_us);
        adapter.allow_large_pdos = self.large_pdos;
        if self.dc_sync0 {
            let sync0_us = self.dc_cycle_us.unwrap_or(self.cycle_us);
            let source = if self.dc_follow { ClockSource::Reference } else { ClockSource::Host };
            let period = Duration::from_micros(sync0_us.into());
            adapter.dc = Some(DcSync { source, ..sync0(period, self.dc_shift_us, &adapter) });
        }
        let profile = EncapsulationProfile::from_raw(self.profile)
            .ok_or_else(|| format!("--profile {} is invalid; allowed: 0, 1, 4, 5", self.profile))?;
        let options = if self.align4 { OptionFlags::ALIGN4 } else { OptionFlags::default() };
        let mut config = PortConfig::uniform(slaves.into(), GatewayConfig::default());
        for (slave, gateway) in config.gateways.iter_mut().enumerate() {
            (gateway.tx_encapsulation, gateway.rx_encapsulation) = (profile, profile);
            (gateway.tx_options, gateway.rx_options) = (options, options);
            // A gateway without a drive takes part with its first channel.
            let is_idle = axes.iter().all(|axis| axis.address.slave != slave);
            for channel in 0..CHANNELS {
                let is_here = |axis: &AxisConfig| {
                    axis.address.slave == slave && usize::from(axis.address.channel) == channel
                };
                if axes.iter().any(is_here) || is_idle && channel == 0 {
                    let settings = ChannelConfig::classic(self.bitrate);
                    gateway.channels[channel] = Some(settings.with_traffic(Traffic::default()));
                }
            }
        }
        Ok((adapter, config))
    }

    /// Settings of the motion, for a picture.
    pub fn setting(&self, slaves: u16) -> String {
        let sync0 = if self.dc_sync0 { ", Sync0" } else { "" };
        format!(
            "{slaves} gateway(s), cycle {} us{sync0}, CAN at {} bit/s, {} inc per target, a target \
             every {} cycle(s)",
            self.cycle_us, self.bitrate, self.step, self.motion_div
        )
    }

    /// Rejects a Sync0 shift that the plan finds among the arrivals of the outputs, unless the options
    /// accept it: a gateway that leaves OP stops its axes.
    ///
    /// # Errors
    /// The warning of the plan.
    pub fn check_sync0(
        &self,
        adapter: &AdapterConfig,
        config: &PortConfig,
    ) -> Result<(), Box<dyn Error>> {
        match config.sync0_warning(adapter).filter(|_| !self.dc_shift_measured) {
            Some(warning) => {
                Err(format!("{warning}; --dc-shift-measured accepts a measured shift").into())
            }
            None => Ok(()),
        }
    }

    /// Opens the Port, without startup SDOs if the options skip them.
    ///
    /// # Errors
    /// The configuration is faulty, or the bus rejects it.
    pub fn open_port(
        &self,
        ecrt: &Ecrt,
        adapter: AdapterConfig,
        config: PortConfig,
    ) -> Result<Port, Box<dyn Error>> {
        print_sync0(&adapter, &config);
        if self.skip_sdo_config {
            return Ok(Port::new(Adapter::open(ecrt, adapter, StartupPlan::default())?, config)?);
        }
        Ok(Port::open(ecrt, (adapter, config))?)
    }
}
