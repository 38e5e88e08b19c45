//! Periods of frames that a gateway sends directly or at a phase of Sync0 (manual 13.9); or a sweep
//! for the best phase of this machine (manual 15.6.1).
//!
//! ```text
//! mcan_gateway_tx_probe --ecrt sim --report probe.html
//! mcan_gateway_tx_probe --cycle-us 1000 --fd 5000000 --rt-priority 80 --bus-log analyser.log
//! mcan_gateway_tx_probe --cycle-us 1000 --sweep
//! ```

use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{CommandFactory as _, Parser};
use ecan_example_support::loop_setup::GatewayArguments;
use ecan_example_support::probe_output::{ProbeFiles, parse_picture, print_sweep};
use ecan_example_support::sync0::{print_sync0, sync0};
use ecan_example_support::tx_probe::{Mode, ModeResult, Modes, Target};
use ecan_example_support::{
    EXIT_STATUS, Interrupt, RealTimeArguments, RunInfo, print_plan, report_exit, wait_ready,
};
use ecan_host::AdapterConfig;
use ecan_lite::EcrtOptions;
use ecan_mcan_port::{FrameStream, GatewayConfig, Port, PortConfig, RECOMMENDED_OFFSET_NS};
use ecan_protocol::can::FrameError;
use ecan_protocol::image::OptionFlags;
use ecan_protocol::mapping::CHANNELS;
use ecan_tool_support::command_line::options::parse_svg_path;
use ecan_tool_support::command_line::screen::{parse_arguments, print_message};
use ecan_tool_support::plot::Heading;
use ecan_tool_support::print_line;

/// Send one numbered CAN frame per cycle, directly and scheduled, and measure the periods
#[derive(Debug, Parser)]
#[command(name = "mcan_gateway_tx_probe", version, after_help = EXIT_STATUS)]
struct Arguments {
    #[command(flatten)]
    gateways: GatewayArguments,
    /// Index of the gateway that sends the frames
    #[arg(long, value_name = "INDEX", default_value_t = 0)]
    slave: u16,
    /// CAN channel that sends the frames
    #[arg(long, value_name = "CHANNEL", default_value_t = 0,
          value_parser = clap::value_parser!(u8).range(..CHANNELS as i64))]
    channel: u8,
    /// EtherCAT cycle and Sync0 period
    #[arg(long, value_name = "US", default_value_t = 1_000)]
    cycle_us: u32,
    /// Number of frames per mode, one per cycle
    #[arg(long, value_name = "N", default_value_t = 1_000,
          value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    frames: u64,
    /// Transmission mode; with `both`, --plan uses the scheduled one
    #[arg(long, value_enum, default_value_t = Modes::Both)]
    mode: Modes,
    /// Phase of scheduled frames after Sync0
    #[arg(long, value_name = "NS", default_value_t = RECOMMENDED_OFFSET_NS)]
    offset_ns: u32,
    /// Start Sync0 also without scheduled frames
    #[arg(long)]
    dc_sync0: bool,
    /// Sync0 shift relative to the cycle [default: the middle of the usable ones, by the plan]
    #[arg(long, value_name = "US")]
    dc_shift_us: Option<u32>,
    /// Analyser's recording of the bus, complete when the frames are sent; source of the bus times
    #[arg(long, value_name = "FILE")]
    bus_log: Option<PathBuf>,
    /// Write the frames of the simulated bus as a candump log
    #[arg(long, value_name = "FILE")]
    bus_dump: Option<PathBuf>,
    /// Write a line per frame as CSV
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write histograms: FILE.html with the table, or FILE.svg alone; with --sweep the shifts, FILE.svg
    #[arg(long, value_name = "FILE", value_parser = parse_picture)]
    report: Option<PathBuf>,
    /// Try Sync0 shifts and offsets, with --frames frames each, and print those without losses
    #[arg(long, conflicts_with_all = ["plan", "mode", "offset_ns", "dc_shift_us", "bus_log", "bus_dump",
                                      "csv"])]
    sweep: bool,
    #[command(flatten)]
    thread: RealTimeArguments,
}

fn main() -> ExitCode {
    let arguments: Arguments = parse_arguments();
    if let Err(error) = arguments.check_picture() {
        return ExitCode::from(print_message(&error));
    }
    report_exit("mcan_gateway_tx_probe", run(&arguments))
}

impl Arguments {
    /// Rejects a page with the table for a sweep, which has a picture only.
    fn check_picture(&self) -> Result<(), clap::Error> {
        let report = self.report.as_ref().filter(|_| self.sweep);
        match report.map(|path| parse_svg_path(&path.to_string_lossy())) {
            Some(Err(reason)) => {
                let message = format!("--report of --sweep: {reason}");
                Err(Self::command().error(ErrorKind::ValueValidation, message))
            }
            _ => Ok(()),
        }
    }

    fn target(&self) -> Target {
        Target {
            slave: self.slave.into(),
            channel: self.channel,
            is_fd: self.gateways.fd.is_some(),
        }
    }

    fn configuration(&self) -> Result<(AdapterConfig, PortConfig), Box<dyn Error>> {
        if self.slave >= self.gateways.slaves {
            let (slave, slaves) = (self.slave, self.gateways.slaves);
            return Err(
                format!("--slave {slave} is out of range; allowed: 0 to {}", slaves - 1).into()
            );
        }
        let mut adapter = self.gateways.adapter(self.cycle_us);
        if self.dc_sync0 || self.sweep || self.mode != Modes::Direct {
            adapter.dc = Some(sync0(adapter.cycle, self.dc_shift_us, &adapter));
        }
        let mut gateway = GatewayConfig::on_channel(self.channel, self.gateways.channel());
        gateway.tx_options = OptionFlags::TX_RESULT;
        Ok((adapter, PortConfig::uniform(self.gateways.slaves.into(), gateway)))
    }

    /// Traffic of a measurement.
    fn traffic(&self) -> Result<FrameStream, FrameError> {
        let stream = self.target().traffic()?;
        Ok(match self.mode {
            Modes::Direct => stream,
            Modes::Scheduled | Modes::Both => stream.scheduled(self.offset_ns),
        })
    }

    fn files(&self) -> ProbeFiles<'_> {
        ProbeFiles {
            bus_log: self.bus_log.as_deref(),
            bus_dump: self.bus_dump.as_deref(),
            csv: self.csv.as_deref(),
            picture: self.report.as_deref(),
        }
    }

    /// Description of the measurement.
    fn setting(&self) -> String {
        let GatewayArguments { bitrate, fd, .. } = self.gateways;
        let pdo_n = self.gateways.pdo_n();
        let kind = match fd {
            Some(data) => format!("CAN FD frames of 16 bytes at {bitrate} and {data} bit/s"),
            None => format!("CAN frames of 8 bytes at {bitrate} bit/s"),
        };
        format!("{} {kind}, one per cycle of {} us, N = {pdo_n}", self.frames, self.cycle_us)
    }
}

fn run(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    let (adapter, config) = arguments.configuration()?;
    if arguments.gateways.plan {
        print_plan(&adapter, &config, &[arguments.traffic()?])?;
        return Ok(true);
    }
    let interrupt = Interrupt::install()?;
    let backend = arguments.gateways.master.open("jitter", EcrtOptions::for_gateways(&adapter))?;
    let files = arguments.files();
    files.check(backend.simulation.is_some())?;
    arguments.thread.apply(|line| print_line!("{line}"))?;
    if !arguments.sweep {
        print_sync0(&adapter, &config);
    }
    let mut port = Port::open(&backend.ecrt, (adapter, config))?;
    if !wait_ready(&mut port, &interrupt)? {
        return Ok(true);
    }
    print_line!("{} gateway(s) ready", port.slave_count());
    arguments.thread.set_timing(port.adapter_mut());
    let target = arguments.target();
    let run_info = RunInfo::of_this_run("mcan_gateway_tx_probe", env!("CARGO_PKG_VERSION"));
    if arguments.sweep {
        let setting = arguments.setting();
        let heading = Heading::new("Usable Sync0 shifts")
            .with_subtitle(setting.clone())
            .simulated(backend.simulation.is_some())
            .with_run(run_info);
        let plot = arguments.report.as_deref().map(|path| (path, heading));
        return print_sweep(&mut port, target, arguments.frames, &setting, plot, &interrupt);
    }
    if let Some(simulation) = &backend.simulation {
        let channel = usize::from(target.channel);
        simulation.with_world(|world| world.record_bus_of(target.slave, channel));
    }
    let results = measure(arguments, &mut port, target, &interrupt)?;
    let (simulation, setting) = (backend.simulation.as_ref(), arguments.setting());
    files.report(&port, simulation, setting, run_info, target, results)?;
    Ok(true)
}

/// Measures each mode in turn.
fn measure(
    arguments: &Arguments,
    port: &mut Port,
    target: Target,
    interrupt: &Interrupt,
) -> Result<Vec<ModeResult>, Box<dyn Error>> {
    let mut results = Vec::new();
    let mut first = 0;
    for mode in arguments.mode.modes(arguments.offset_ns) {
        if let Mode::Scheduled { offset_ns } = mode {
            let margin = port
                .schedule_margin(port.gateway(target.slave)?, offset_ns)
                .map_err(|reason| format!("--offset-ns {offset_ns}: {reason}"))?;
            print_line!("{mode}: {margin}");
        }
        let result = target.measure(port, mode, first..first + arguments.frames, interrupt)?;
        first = result.numbers.end;
        results.push(result);
        if interrupt.is_set() {
            print_line!("stopped by the user");
            break;
        }
    }
    Ok(results)
}
