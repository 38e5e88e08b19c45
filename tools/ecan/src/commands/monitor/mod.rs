//! `ecan monitor`: gateways, channels and the cycle at a glance.

mod collector;
mod hang_up;
mod keys;
mod observation;
mod screen;
mod snapshot;
mod terminal;
mod text;
mod watcher;

use std::io::IsTerminal;

use clap::Args;
use ecan_command_line::interrupt::Interrupt;
use ecan_sim::ClockKind;

use crate::failure::Failure;
use crate::frames::channels::Channels;
use crate::frames::options::GatewayOptions;
use crate::frames::settings::Settings;
use crate::global::GlobalOptions;
use crate::output::Output;

use collector::Collector;
use observation::Observation;
use watcher::Watcher;

/// Between two looks at the gateways, in nanoseconds.
const LOOK_NS: u64 = 100_000_000;

/// Examples for the end of the help.
pub const EXAMPLES: &str = "\
Examples:
  ecan monitor --bitrate 1000000               all gateways of the bus, on the whole terminal
  ecan --slave 1 monitor --listen-only         one gateway, without taking part in its CAN buses
  ecan monitor --config cell.toml              the gateways of a file, set as it says
  ecan monitor --once --for 10                 print how things stand after 10 seconds
  ecan monitor --for 60 --json > minute.json   for other programs

Keys: q, Esc, Ctrl-C end; p pause; c clear counters; arrows choose gateway and channel; ? help.

The program runs the cycle itself: it cannot watch beside another application of the master.
Where standard output is no terminal, it prints once. Then the exit status is 1 where a gateway
is not in service at the end, or a channel off the bus.

Load is the share of the CAN bus of the frames that reach the host, without stuff bits: it leaves
out what filters or full buffers keep back. TEC and REC are the error counters of the CAN controller.
Dropped frames and bus-offs are the gateway's own counters, since it was switched on, until c is
pressed; all others count from the start.";

/// Arguments of `monitor`.
#[derive(Debug, Args)]
pub struct MonitorArguments {
    /// Print once how things stand, without the whole terminal
    #[arg(long)]
    once: bool,
    /// Watch for so many seconds, then print; as --once
    #[arg(long = "for", value_name = "SECONDS", value_parser = parse_seconds)]
    seconds: Option<f64>,
    /// Channels to enable, 0 to 3 with commas between, or all; with --config those of the file
    #[arg(long, value_name = "CHANNELS", default_value = "all", conflicts_with = "config")]
    channel: Channels,
    /// Listen without acknowledging: another node on the bus has to
    #[arg(long)]
    listen_only: bool,
    #[command(flatten)]
    options: GatewayOptions,
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|it| (0.001..=1e6).contains(it));
    seconds.ok_or_else(|| "expected seconds, 0.001 to 1000000".to_owned())
}

pub fn run(
    arguments: &MonitorArguments,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    // The terminal has to be put back, which takes a second at most.
    let interrupt = Interrupt::install_patient()?;
    let is_asked_once = arguments.once || arguments.seconds.is_some() || global.json;
    if is_asked_once || !std::io::stdout().is_terminal() {
        return print_once(arguments, &interrupt, is_asked_once, global, output);
    }
    let settings = Settings::of(&arguments.options)?;
    let bus = settings.open_bus(global, output, ClockKind::Real)?;
    let watcher = Watcher::open(&bus, &settings, arguments, global)?;
    terminal::run(watcher, arguments, &interrupt, output)
}

/// Watches for some time, then prints.
fn print_once(
    arguments: &MonitorArguments,
    interrupt: &Interrupt,
    is_asked: bool,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    let seconds = arguments.seconds.unwrap_or(1.0);
    let settings = Settings::of(&arguments.options)?;
    let bus = settings.open_bus(global, output, ClockKind::Stepped)?;
    if !is_asked {
        output.note(format_args!(
            "standard output is no terminal: printing once, after {seconds} s, as with --once"
        ));
    }
    let mut watcher = Watcher::open(&bus, &settings, arguments, global)?;
    let granted = arguments.options.real_time.apply(|line| output.note(line));
    granted.map_err(|error| Failure::Host(error.to_string()))?;
    let length_ns = (seconds * 1e9) as u64;
    let (cycle_ns, is_simulated) = (watcher.cycle_ns(), watcher.is_simulated());
    let mut collector = Collector::new(watcher.positions(), cycle_ns, length_ns, is_simulated);
    let mut observation = Observation::new(watcher.positions().len());
    watcher.activate(&arguments.options)?;
    let mut look_ns = 0;
    let mut look = |watcher: &Watcher, observation: &mut Observation, is_last: bool| {
        let now_ns = watcher.now_ns();
        if now_ns >= look_ns || is_last || observation.is_nearly_full() {
            look_ns = now_ns.saturating_add(LOOK_NS);
            watcher.look(observation);
            collector.take(observation);
            observation.clear();
        }
    };
    watcher.wait_ready(interrupt, |it, seen| look(it, seen, false), &mut observation)?;
    look(&watcher, &mut observation, true);
    let end_ns = watcher.now_ns().saturating_add(length_ns);
    while watcher.now_ns() < end_ns && !interrupt.is_set() {
        watcher.cycle(&mut observation)?;
        look(&watcher, &mut observation, false);
    }
    look(&watcher, &mut observation, true);
    for (at, errors) in watcher.read_errors().into_iter().enumerate() {
        collector.take_errors(at, errors);
    }
    let snapshot = collector.snapshot();
    output.data(&snapshot, |out| text::print(out, &snapshot))?;
    if snapshot.has_problem() { Err(Failure::ProblemsFound) } else { Ok(()) }
}
