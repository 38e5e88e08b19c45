//! How steadily frames leave a gateway, sent directly or scheduled to a phase of Sync0
//! (manual 13.9); or which phase suits this machine (manual 15.6.1).
//!
//! ```text
//! mcan_gateway_tx_probe --ecrt sim --report probe.html
//! mcan_gateway_tx_probe --cycle-us 1000 --fd 5000000 --rt-priority 80 --spin-us 100 \
//!     --bus-log analyser.log
//! mcan_gateway_tx_probe --cycle-us 1000 --sweep
//! mcan_gateway_tx_probe --plan --cycle-us 1000 --dc-shift-us 700 --offset-ns 100000
//! ```

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use ecan_example_support::bus_periods::BusRecord;
use ecan_example_support::gateway_arguments::GatewayArguments;
use ecan_example_support::log_file;
use ecan_example_support::phase_sweep::{PhaseSweep, sweep_phase};
use ecan_example_support::probe_report::{Report, Row};
use ecan_example_support::tx_probe::{Mode, Target, probe_id};
use ecan_example_support::{
    Interrupt, RealTimeArguments, print_plan, real_time, report_exit, wait_ready,
};
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::{FrameStream, GatewayConfig, Port, PortConfig, RECOMMENDED_OFFSET_NS};
use ecan_protocol::can::FrameError;
use ecan_protocol::image::OptionFlags;
use ecan_protocol::mapping::CHANNELS;
use ecan_sim::{BusFrame, Simulation};

/// Sync0 shift unless told otherwise, in percent of the cycle: behind the arrival of the images.
const DEFAULT_SHIFT_PERCENT: u32 = 70;

/// Sends one numbered CAN frame per cycle, directly and scheduled, and measures the periods.
#[derive(Debug, Parser)]
#[command(name = "mcan_gateway_tx_probe", version)]
struct Arguments {
    #[command(flatten)]
    gateways: GatewayArguments,
    /// Index of the gateway that sends the frames.
    #[arg(long, value_name = "INDEX", default_value_t = 0)]
    slave: u16,
    /// CAN channel that sends the frames.
    #[arg(long, value_name = "CHANNEL", default_value_t = 0,
          value_parser = clap::value_parser!(u8).range(..CHANNELS as i64))]
    channel: u8,
    /// EtherCAT cycle in microseconds, and Sync0 period.
    #[arg(long, value_name = "US", default_value_t = 1_000)]
    cycle_us: u32,
    /// Number of frames for each way of sending, one per cycle.
    #[arg(long, value_name = "N", default_value_t = 1_000,
          value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    frames: u64,
    /// How the frames are sent; of `both`, --plan plans the scheduled way.
    #[arg(long, value_enum, default_value_t = Modes::Both)]
    mode: Modes,
    /// Phase of scheduled frames behind Sync0, in nanoseconds.
    #[arg(long, value_name = "NS", default_value_t = RECOMMENDED_OFFSET_NS)]
    offset_ns: u32,
    /// Start Sync0 also where nothing is scheduled.
    #[arg(long)]
    dc_sync0: bool,
    /// Sync0 shift against the cycle, in microseconds [default: 70 % of the cycle].
    #[arg(long, value_name = "US")]
    dc_shift_us: Option<u32>,
    /// An analyser's candump log of the bus, which is complete when the frames have been sent:
    /// read at the end for the times of the frames.
    #[arg(long, value_name = "FILE")]
    bus_log: Option<PathBuf>,
    /// Write what went over the simulated bus as a candump log.
    #[arg(long, value_name = "FILE")]
    bus_dump: Option<PathBuf>,
    /// Write a line for each frame as CSV.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write histograms: FILE.html with the table, or FILE.svg alone.
    #[arg(long, value_name = "FILE", value_parser = parse_picture)]
    report: Option<PathBuf>,
    /// Try Sync0 shifts and offsets instead, with as many frames each as --frames says, and print
    /// which of them lose nothing.
    #[arg(long, conflicts_with_all = ["plan", "mode", "offset_ns", "dc_shift_us", "bus_log", "bus_dump",
                                      "csv", "report"])]
    sweep: bool,
    #[command(flatten)]
    thread: RealTimeArguments,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Modes {
    /// Each frame when the gateway gets it.
    Direct,
    /// Each frame at its phase of Sync0.
    Scheduled,
    /// One after the other.
    Both,
}

fn parse_picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let is_known = path.extension().is_some_and(|it| it == "html" || it == "svg");
    if is_known { Ok(path) } else { Err("expected a name that ends in .html or .svg".into()) }
}

fn main() -> ExitCode {
    report_exit("mcan_gateway_tx_probe", run(&Arguments::parse()))
}

impl Arguments {
    fn modes(&self) -> Vec<Mode> {
        let scheduled = Mode::Scheduled { offset_ns: self.offset_ns };
        match self.mode {
            Modes::Direct => vec![Mode::Direct],
            Modes::Scheduled => vec![scheduled],
            Modes::Both => vec![Mode::Direct, scheduled],
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
                format!("--slave {slave} is not among {slaves} gateway(s), from 0 on").into()
            );
        }
        let mut adapter = self.gateways.adapter(self.cycle_us);
        if self.dc_sync0 || self.sweep || self.mode != Modes::Direct {
            let shift_ns = match self.dc_shift_us {
                Some(us) => us.saturating_mul(1_000),
                None => adapter.cycle_ns() / 100 * DEFAULT_SHIFT_PERCENT,
            };
            adapter.dc = Some(DcSync::new(adapter.cycle_ns(), shift_ns));
        }
        let mut gateway = GatewayConfig::on_channel(self.channel, self.gateways.channel());
        gateway.tx_options = OptionFlags::TX_RESULT;
        Ok((adapter, PortConfig::uniform(self.gateways.slaves.into(), gateway)))
    }

    /// The frames of a measurement.
    fn traffic(&self) -> Result<FrameStream, FrameError> {
        let stream = self.target().traffic()?;
        Ok(match self.mode {
            Modes::Direct => stream,
            Modes::Scheduled | Modes::Both => stream.scheduled(self.offset_ns),
        })
    }

    /// How it is measured, in words.
    fn setting(&self) -> String {
        let kind = match self.gateways.fd {
            Some(data) => {
                format!("CAN FD frames of 16 bytes at {} and {data} bit/s", self.gateways.bitrate)
            }
            None => format!("CAN frames of 8 bytes at {} bit/s", self.gateways.bitrate),
        };
        let (frames, cycle, n) = (self.frames, self.cycle_us, self.gateways.pdo_n);
        format!("{frames} {kind}, one per cycle of {cycle} us, N = {n}")
    }
}

/// Runs the probe.
fn run(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    let (adapter, config) = arguments.configuration()?;
    if arguments.gateways.plan {
        print_plan(&adapter, &config, &[arguments.traffic()?])?;
        return Ok(true);
    }
    // What is not there shall not be told after the measurement. A log may come into being
    // meanwhile, but not its directory.
    for path in [&arguments.csv, &arguments.report, &arguments.bus_dump].into_iter().flatten() {
        check_writable(path)?;
    }
    let interrupt = Interrupt::install()?;
    let backend = arguments.gateways.open_backend("jitter", &adapter)?;
    if arguments.bus_dump.is_some() && backend.simulation.is_none() {
        return Err("--bus-dump needs a simulated bus".into());
    }
    arguments.thread.apply(|line| println!("{line}"))?;
    let mut port = Port::open(&backend.ecrt, (adapter, config))?;
    if !wait_ready(&mut port, &interrupt)? {
        println!("stopped by the user");
        return Ok(true);
    }
    println!("{} gateway(s) ready", port.slave_count());
    arguments.thread.set_timing(port.adapter_mut());
    if arguments.sweep {
        return sweep(arguments, &mut port, &interrupt);
    }
    measure(arguments, &mut port, backend.simulation.as_ref(), &interrupt)
}

fn check_writable(path: &Path) -> Result<(), Box<dyn Error>> {
    let opened = std::fs::OpenOptions::new().append(true).create(true).open(path);
    opened.map(drop).map_err(|e| format!("cannot write {}: {e}", path.display()).into())
}

/// Sends everything and reports.
fn measure(
    arguments: &Arguments,
    port: &mut Port,
    simulation: Option<&Simulation>,
    interrupt: &Interrupt,
) -> Result<bool, Box<dyn Error>> {
    let target = arguments.target();
    let channel = usize::from(arguments.channel);
    if let Some(simulation) = simulation {
        simulation.with_world(|world| world.record_bus_of(target.slave, channel));
    }
    let mut results = Vec::new();
    let mut first = 0;
    for mode in arguments.modes() {
        if let Mode::Scheduled { offset_ns } = mode {
            let margin = port.schedule_margin(port.gateway(target.slave)?, offset_ns);
            match margin {
                Ok(margin) => println!("{mode}: {margin}"),
                Err(reason) => return Err(format!("--offset-ns {offset_ns}: {reason}").into()),
            }
        }
        let result = target.measure(port, mode, first..first + arguments.frames, interrupt)?;
        first = result.numbers.end;
        results.push(result);
        if interrupt.is_set() {
            println!("stopped by the user");
            break;
        }
    }
    let recorded: Option<Vec<BusFrame>> =
        simulation.map(|simulation| simulation.with_world(|world| world.take_recorded()));
    // A log that cannot be read is no reason to keep back what was measured.
    let (record, bus_source, fault) = match bus_record(arguments, recorded.as_deref()) {
        Ok((record, words)) => (record, words, Ok(())),
        Err(error) => (None, "no times on the bus: the log cannot be used".into(), Err(error)),
    };
    for result in &results {
        println!("\n{}:", result.mode);
        real_time::print_statistics(port.adapter(), &result.statistics);
    }
    let row = |result: ecan_example_support::tx_probe::ModeResult| Row {
        bus: record.as_ref().map(|record| record.periods(result.numbers.clone())),
        result,
    };
    let report = Report {
        cycle_ns: arguments.cycle_us * 1_000,
        setting: arguments.setting(),
        banner: simulation.map(Simulation::banner),
        bus_source,
        rows: results.into_iter().map(row).collect(),
    };
    println!("\n{}", report.setting);
    print!("{}", report.table());
    for note in report.notes().iter().skip(1) {
        println!("{note}");
    }
    if let (Some(path), Some(frames)) = (&arguments.bus_dump, &recorded) {
        let mut dump = log_file::Writer::create(path)?;
        for frame in frames {
            dump.write(frame.start_ns, channel, frame.frame)?;
        }
        dump.finish()?;
    }
    if let Some(path) = &arguments.csv {
        report.write_csv(path)?;
    }
    if let Some(path) = &arguments.report {
        report.write_picture(path)?;
    }
    fault?;
    Ok(true)
}

/// The times on the bus, and where they come from in words.
fn bus_record(
    arguments: &Arguments,
    recorded: Option<&[BusFrame]>,
) -> Result<(Option<BusRecord>, String), Box<dyn Error>> {
    if let Some(path) = &arguments.bus_log {
        let record = BusRecord::from_log(path, probe_id())?;
        let steps = match record.resolution_ns {
            1 => "",
            _ => ", whose time stamps are whole microseconds",
        };
        let words = format!("times on the bus from {}{steps}", path.display());
        return Ok((Some(record), words));
    }
    Ok(match recorded {
        Some(frames) => {
            let record = BusRecord::from_simulation(frames, probe_id());
            (Some(record), "times on the bus from the simulated bus".into())
        }
        None => (None, "no bus log: --bus-log FILE gives the times on the bus".into()),
    })
}

/// Tries phases and prints the table.
fn sweep(
    arguments: &Arguments,
    port: &mut Port,
    interrupt: &Interrupt,
) -> Result<bool, Box<dyn Error>> {
    let sweep = PhaseSweep {
        cycles: u32::try_from(arguments.frames)?,
        ..PhaseSweep::over(arguments.cycle_us * 1_000)
    };
    let target = arguments.target();
    let (count, mut done) = (sweep.shifts_ns.len() * sweep.offsets_ns.len(), 0);
    let progress = ecan_example_support::progress::bar(count as u64);
    let table = sweep_phase(
        port,
        &sweep,
        |port, offset_ns| -> Result<(), Box<dyn Error>> {
            if interrupt.is_set() {
                return Err("stopped by the user".into());
            }
            Ok(target.sweep_cycle(port, offset_ns)?)
        },
        |_| {
            done += 1;
            progress.set_position(done);
        },
    );
    progress.finish_and_clear();
    let table = table?;
    println!("{} with {} cycles for each point", arguments.setting(), sweep.cycles);
    println!("{table}");
    if let Some(best) = table.recommended() {
        let (shift, offset) = (f64::from(best.shift_ns) / 1e3, best.offset_ns);
        println!(
            "confirm it in a run of minutes: --dc-shift-us {shift:.0} --offset-ns {offset} \
             --frames {}",
            120_000_000 / u64::from(arguments.cycle_us.max(1))
        );
    }
    Ok(table.recommended().is_some())
}
