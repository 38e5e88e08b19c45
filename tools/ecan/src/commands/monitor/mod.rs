//! `ecan monitor`: live view of gateways, channels and cycle.

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

use crate::context::{Context, Failure, Result, note};
use crate::frames::{Channels, GatewayOptions, Settings};

use observation::Observation;
use watcher::Watcher;

const LOOK_NS: u64 = 100_000_000;

pub const EXAMPLES: &str = "\
Examples:
  ecan monitor --bitrate 1000000               all gateways of the bus, in full-screen mode
  ecan --slave 1 monitor --listen-only         one gateway, without acknowledging on its CAN buses
  ecan monitor --config cell.toml              the gateways of a file, with its settings
  ecan monitor --once --for 10                 print the state after 10 seconds
  ecan monitor --for 60 --json > minute.json   JSON output

Keys: q, Esc, Ctrl-C end; p pause; c clear counters; arrows select gateway and channel; ? help.

The command runs the cycle itself: it cannot run in parallel with another application of the master.
If standard output is not a terminal, it prints once. Exit status 1 if a gateway is not ready at the
end or a channel is bus-off.

Load is the bus load of the frames that reach the host, without stuff bits and without frames that
filters or full buffers drop. TEC and REC are the error counters of the CAN controller. Dropped frames
and bus-offs are counted by the gateway from its start or the last clear, all others from the start.";

#[derive(Debug, Args)]
pub struct MonitorArguments {
    /// Print the current state once and exit, without full-screen mode
    #[arg(long)]
    once: bool,
    /// Observe for this time, in s, then print as with --once
    #[arg(long = "for", value_name = "SECONDS", value_parser = parse_seconds)]
    seconds: Option<f64>,
    /// Channels to enable, 0 to 3, comma-separated, or all; with --config: channels of the file
    #[arg(long, value_name = "CHANNELS", default_value = "all", conflicts_with = "config")]
    channel: Channels,
    /// Listen without acknowledging; another node must acknowledge
    #[arg(long)]
    listen_only: bool,
    #[command(flatten)]
    options: GatewayOptions,
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|it| (0.001..=1e6).contains(it));
    seconds.ok_or_else(|| "expected seconds, 0.001 to 1000000".to_owned())
}

pub fn run(arguments: &MonitorArguments, context: &Context) -> Result {
    // The terminal must be restored, which takes up to a second.
    let interrupt = Interrupt::install_patient()?;
    let is_asked_once = arguments.once || arguments.seconds.is_some() || context.global.json;
    if is_asked_once || !std::io::stdout().is_terminal() {
        return print_once(arguments, &interrupt, is_asked_once, context);
    }
    let settings = Settings::of(&arguments.options)?;
    let bus = settings.open_bus(context, ClockKind::Real)?;
    let watcher = Watcher::open(&bus, &settings, arguments, context.global)?;
    terminal::run(watcher, arguments, &interrupt, &context.output)
}

fn print_once(
    arguments: &MonitorArguments,
    interrupt: &Interrupt,
    is_asked: bool,
    context: &Context,
) -> Result {
    let seconds = arguments.seconds.unwrap_or(1.0);
    let settings = Settings::of(&arguments.options)?;
    let bus = settings.open_bus(context, ClockKind::Stepped)?;
    if !is_asked {
        note(format_args!(
            "standard output is not a terminal: printing once after {seconds} s, as with --once"
        ));
    }
    let mut watcher = Watcher::open(&bus, &settings, arguments, context.global)?;
    arguments.options.real_time.apply(|line| note(line))?;
    let length_ns = (seconds * 1e9) as u64;
    let mut collector = watcher.collector(length_ns);
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
    context.output.data(&snapshot, |out| text::print(out, &snapshot))?;
    if snapshot.has_problem() { Err(Failure::ProblemsFound) } else { Ok(()) }
}
