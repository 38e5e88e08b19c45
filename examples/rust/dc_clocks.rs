//! Synchrony of host and slaves with distributed clocks (manual 8.4, 15.6).
//!
//! ```text
//! dc_clocks --ecrt sim:examples/scenarios/drift.toml --slaves 3 --source reference --plot clocks.svg
//! dc_clocks --slaves 3 --cycle-us 1000 --shift-us 300 --source reference --rt-priority 80
//! ```

use std::error::Error;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use ecan_example_support::MasterArguments;
use ecan_example_support::sync0::{print_sync0, sync0};
use ecan_example_support::{
    EXIT_STATUS, Interrupt, RealTimeArguments, RunInfo, real_time, report_exit, wait_ready,
};
use ecan_host::{ClockSource, ClockStatus, DcSync};
use ecan_lite::EcrtOptions;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_tool_support::command_line::options::parse_svg_path;
use ecan_tool_support::command_line::screen::{Stream, parse_arguments, print};
use ecan_tool_support::plot;
use ecan_tool_support::plot::{
    AxisKind, CurveFigure, CurvePanel, CurveStack, Heading, Mark, PlotError, Series, Tone,
};
use ecan_tool_support::print_line;

/// Interval of the printed lines, ns.
const LINE_NS: u64 = 1_000_000_000;

/// Show the synchrony of host and slaves with distributed clocks
#[derive(Debug, Parser)]
#[command(name = "dc_clocks", version, after_help = EXIT_STATUS)]
struct Arguments {
    #[command(flatten)]
    master: MasterArguments,
    /// Number of gateways
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    slaves: u16,
    /// PDO size per direction, in chunks of 128 bytes
    #[arg(long, value_name = "N", default_value_t = 3)]
    pdo_n: u8,
    /// Allow PDOs above 1486 bytes: the master must split them into datagrams
    #[arg(long)]
    large_pdos: bool,
    /// EtherCAT cycle and period of Sync0
    #[arg(long, value_name = "US", default_value_t = 1_000)]
    cycle_us: u32,
    /// Shift of Sync0 [default: the middle of the usable ones, by the plan]
    #[arg(long, value_name = "US")]
    shift_us: Option<u32>,
    /// Number of cycles
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    cycles: u64,
    /// Clock that the others follow
    #[arg(long, value_enum, default_value_t = Source::Host)]
    source: Source,
    /// Slave with the reference clock [default: the first on the bus]
    #[arg(long, value_name = "SLAVE")]
    reference: Option<usize>,
    /// Phase error below which the clocks count as settled; the run fails if they are not at its end
    #[arg(long, value_name = "US", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    settled_us: u32,
    /// Write a picture of the phase error
    #[arg(long, value_name = "FILE.svg", value_parser = parse_svg_path)]
    plot: Option<PathBuf>,
    #[command(flatten)]
    thread: RealTimeArguments,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Source {
    /// The slaves follow the host
    Host,
    /// The cycle of the host follows the reference clock
    Reference,
}

fn main() -> ExitCode {
    report_exit("dc_clocks", run(&parse_arguments()))
}

/// Gateways with Sync0 at the cycle, and whether they are simulated.
fn open_port(arguments: &Arguments) -> Result<(Port, bool), Box<dyn Error>> {
    let Arguments { slaves, pdo_n, cycle_us, .. } = *arguments;
    let mut adapter = arguments.master.adapter(slaves, pdo_n, cycle_us);
    adapter.allow_large_pdos = arguments.large_pdos;
    adapter.dc = Some(DcSync {
        source: match arguments.source {
            Source::Host => ClockSource::Host,
            Source::Reference => ClockSource::Reference,
        },
        reference: arguments.reference,
        ..sync0(adapter.cycle, arguments.shift_us, &adapter)
    });
    let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(1_000_000));
    let config = PortConfig::uniform(slaves.into(), gateway);
    print_sync0(&adapter, &config);
    let backend = arguments.master.open("echo", EcrtOptions::for_gateways(&adapter))?;
    arguments.thread.apply(|line| print_line!("{line}"))?;
    Ok((Port::open(&backend.ecrt, (adapter, config))?, backend.simulation.is_some()))
}

/// Runs the clocks. Returns whether they settled.
fn run(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    // A file that cannot be written is reported before anything is measured.
    plot::check_file(arguments.plot.as_deref())?;
    let interrupt = Interrupt::install()?;
    let (mut port, is_simulated) = open_port(arguments)?;
    if !wait_ready(&mut port, &interrupt)? {
        return Ok(true);
    }
    arguments.thread.set_timing(port.adapter_mut());
    port.adapter_mut().measure_cycles();
    let start = port.adapter().cycle_time_ns();
    let mut results = Results::default();
    let mut clock_plot = ClockPlot::new(arguments.cycles);
    print_line!("   time   phase error      rate   synchrony  missed");
    for cycle in 0..arguments.cycles {
        if interrupt.is_set() {
            print_line!("stopped by the user");
            break;
        }
        // A lost frame shows in the figures.
        port.next_cycle().finish();
        let Some(status) = port.adapter().clock_status() else { continue };
        let time = port.adapter().cycle_time_ns().saturating_sub(start);
        results.take(cycle, status, arguments.settled_us);
        clock_plot.sample(cycle, time as f64 / 1e9, status);
        if results.line_due(time) {
            print_line!("{:6.1} s {}", time as f64 / 1e9, line(status));
        }
    }
    print(Stream::Output, results.summary(arguments.cycle_us, arguments.settled_us));
    if let Some(statistics) = port.adapter().cycle_statistics() {
        real_time::print_statistics(port.adapter(), statistics);
    }
    if let Some(path) = &arguments.plot {
        let source = match arguments.source {
            Source::Host => "the slaves follow the host",
            Source::Reference => "the cycle of the host follows the reference clock",
        };
        let (slaves, cycle_us) = (arguments.slaves, arguments.cycle_us);
        let heading = Heading::new("Phase error of the distributed clocks")
            .with_subtitle(format!("{slaves} gateway(s), cycle {cycle_us} us, {source}"))
            .simulated(is_simulated)
            .with_run(RunInfo::of_this_run("dc_clocks", env!("CARGO_PKG_VERSION")));
        clock_plot.write(path, heading)?;
    }
    Ok(results.settled_since.is_some())
}

fn line(status: ClockStatus) -> String {
    let phase = status.phase_error_ns.map_or("unknown".into(), |ns| format!("{ns} ns"));
    let synchrony = status.synchrony_ns.map_or("unknown".into(), |ns| format!("{ns} ns"));
    let rate = f64::from(status.rate_ppb) / 1e3;
    let locked = if status.is_locked { "" } else { "  not locked" };
    format!("{phase:>13} {rate:+7.2} ppm {synchrony:>11} {:>7}{locked}", status.missed_readings)
}

/// Results of the run.
#[derive(Debug, Default)]
struct Results {
    lines: u64,
    largest_ns: u32,
    /// First cycle of the present period with a small phase error.
    settled_since: Option<u64>,
    last: Option<ClockStatus>,
}

impl Results {
    fn take(&mut self, cycle: u64, status: ClockStatus, settled_us: u32) {
        self.last = Some(status);
        let Some(error) = status.phase_error_ns.map(i32::unsigned_abs) else { return };
        self.largest_ns = self.largest_ns.max(error);
        if error >= settled_us * 1_000 {
            self.settled_since = None;
        } else {
            self.settled_since.get_or_insert(cycle);
        }
    }

    fn line_due(&mut self, time_ns: u64) -> bool {
        let due = time_ns >= self.lines * LINE_NS;
        self.lines += u64::from(due);
        due
    }

    fn summary(&self, cycle_us: u32, settled_us: u32) -> String {
        let Some(last) = self.last else { return "no cycle was run\n".into() };
        let settled = match self.settled_since {
            Some(cycle) => format!("below {settled_us} us since cycle {cycle} of {cycle_us} us"),
            None => format!("not below {settled_us} us at the end"),
        };
        let largest = f64::from(self.largest_ns) / 1e3;
        format!(
            "\nphase error: largest {largest:.3} us, {settled}\nrate of the host against the \
             reference clock: {:+.3} ppm\nreadings missed: {}\n",
            f64::from(last.rate_ppb) / 1e3,
            last.missed_readings
        )
    }
}

/// Maximum number of samples in a picture.
const SAMPLES: u64 = 4_000;
const PANEL: u32 = 270;
/// Range of the lower panel in both directions, us.
const CLOSE_US: f64 = 1.5;

/// Time in seconds, phase error in microseconds.
type Sample = (f64, f64);

/// Samples of a run, drawn at its end.
#[derive(Debug)]
struct ClockPlot {
    every: u64,
    samples: Vec<Sample>,
    /// Times in seconds at which readings were missed.
    missed: Vec<f64>,
    missed_readings: u64,
    /// Largest phase error since the last sample, so that no peak is lost.
    peak: Option<Sample>,
}

impl ClockPlot {
    /// Creates a plot for this number of cycles.
    fn new(cycles: u64) -> Self {
        let every = cycles.div_ceil(SAMPLES).max(1);
        let samples = usize::try_from(cycles / every + 1).unwrap_or(0);
        Self {
            every,
            samples: Vec::with_capacity(samples),
            missed: Vec::with_capacity(samples),
            missed_readings: 0,
            peak: None,
        }
    }

    /// Adds the status of a cycle. Allocates only for more missed readings than samples.
    fn sample(&mut self, cycle: u64, seconds: f64, status: ClockStatus) {
        let missed = status.missed_readings;
        if missed > self.missed_readings {
            self.missed_readings = missed;
            self.missed.push(seconds);
        } else if let Some(ns) = status.phase_error_ns {
            let sample = (seconds, f64::from(ns) / 1e3);
            let is_larger = self.peak.is_none_or(|peak| peak.1.abs() <= sample.1.abs());
            self.peak = if is_larger { Some(sample) } else { self.peak };
        }
        if cycle.is_multiple_of(self.every) {
            self.samples.extend(self.peak.take());
        }
    }

    /// Writes the picture: all samples, and an enlarged part around 0.
    ///
    /// # Errors
    /// The file cannot be written.
    fn write(&self, path: &Path, heading: Heading) -> Result<(), PlotError> {
        let whole = self.panel("phase error", None);
        let enlarged = self.panel("phase error, enlarged", Some(-CLOSE_US..CLOSE_US));
        let stack = CurveStack {
            x_label: "time since the first cycle [s]".to_owned(),
            x_kind: AxisKind::Linear,
            panels: vec![(whole, PANEL), (enlarged, PANEL)],
        };
        CurveFigure { heading, stacks: vec![stack] }.write(path)
    }

    fn panel(&self, title: &str, y: Option<Range<f64>>) -> CurvePanel {
        let phase_error = Series {
            name: "phase error".to_owned(),
            tone: Tone::Difference,
            points: self.samples.iter().map(|(seconds, us)| (*seconds, Some(*us))).collect(),
        };
        let missed =
            |seconds: &f64| Mark { seconds: *seconds, text: String::new(), is_fault: false };
        CurvePanel {
            title: title.to_owned(),
            y_label: "phase error [us]".to_owned(),
            y,
            least_width: 2.0,
            series: vec![phase_error],
            marks: self.missed.iter().map(missed).collect(),
            mark_name: "reading missed".to_owned(),
            ..CurvePanel::default()
        }
    }
}
