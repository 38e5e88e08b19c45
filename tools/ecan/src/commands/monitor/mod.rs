//! `ecan monitor`: live view of gateways, channels and cycle.

mod collector;
mod cycle_times;
mod id_table;
mod keys;
mod observation;
mod port_source;
mod screen;
mod service_source;
mod snapshot;
mod terminal;
#[cfg(test)]
mod test_snapshots;
mod text;
mod views;

use std::sync::Arc;

use clap::Args;
use collector::Collector;
use ecan_sim::ClockKind;
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::options::milliseconds;
use ecan_tool_support::command_line::screen::Stream;
use keys::{Choice, Sort, View};
use observation::{LOOK_NS, Observation, Source};
use port_source::PortSource;
use service_source::ServiceSource;
use snapshot::{Head, IdReport, IdsReport, Snapshot, ViewReport};

use crate::context::{Context, Failure, Result, note};
use crate::frames::{Channels, DbcOption, GatewayOptions, GatewayRequirements, Settings, Signals};

pub const EXAMPLES: &str = "\
Examples:
  ecan monitor                                 the bus of a running service (ecan serve, application)
  ecan monitor --via /run/cell.sock            as above, by its socket
  ecan monitor --bitrate 1M                    without a service: all gateways of the bus
  ecan --slave 1 monitor --listen-only         one gateway, without acknowledging on its CAN buses
  ecan monitor --config cell.toml              the gateways of a file, with its settings
  ecan monitor --view ids --channel 0          frames by CAN ID, on channel 0
  ecan monitor --view ids --dbc cell.dbc       with the signals of the selected frame
  ecan monitor --view axes --once              print the axes of the application
  ecan monitor --for 1min --json > minute.json   JSON output after a minute

Keys: 1, 2, 3 views; q, Esc, Ctrl-C end; p pause; c clear counters; arrows select; s order of the
CAN IDs; ? help.

Through a service the command runs in parallel with the application and only reads. A service samples
the times of the cycle, so that it reports no periods. Without a service the command runs the cycle
itself: it cannot run in parallel with another application of the master.
If standard output is not a terminal, it prints once. Exit status 1 if a gateway is not ready at the
end, a channel is bus-off or an axis has an error.

Load is the bus load of the frames that reach the host or that programs send, without stuff bits and
without frames that filters or full buffers drop. TEC and REC are the error counters of the CAN
controller. Dropped frames and bus-offs are counted by the gateway from its start or the last clear,
all others from the start of the command.

CAN IDs: bus is gateway.channel; dir is rx, tx (sent by a program, through a service only) or err
(sent without success); F after the DLC is CAN FD, R a remote frame. Times are those of the cycle.
Marked bytes changed in the last second; with --once, since the start. At most 4096 CAN IDs are listed.";

#[derive(Debug, Args)]
pub struct MonitorArguments {
    /// Print the current state once and exit, without full-screen mode
    #[arg(long)]
    once: bool,
    /// Observe for this time, then print as with --once
    #[arg(long = "for", value_name = "TIME", value_parser = parse_seconds)]
    seconds: Option<f64>,
    /// First view; with --once and --json the printed one
    #[arg(long, value_enum, value_name = "VIEW", default_value_t)]
    view: View,
    /// Order of the CAN IDs
    #[arg(long, value_enum, value_name = "ORDER", default_value_t)]
    sort: Sort,
    /// Channels to enable, or to list through a service; 0 to 3, comma-separated, or all
    #[arg(long, value_name = "CHANNELS", default_value = "all", conflicts_with = "config")]
    channel: Channels,
    /// Listen without acknowledging; another node must acknowledge
    #[arg(long)]
    listen_only: bool,
    #[command(flatten)]
    signals: DbcOption,
    #[command(flatten)]
    options: GatewayOptions,
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    milliseconds::<u32>(100..=1_000_000_000)(text).map(|ms| f64::from(ms) / 1e3)
}

pub fn run(arguments: &MonitorArguments, context: &Context) -> Result {
    // The terminal must be restored, which takes up to a second.
    let interrupt = Interrupt::install_patient()?;
    let is_asked_once = arguments.once || arguments.seconds.is_some() || context.global.json;
    let is_once = is_asked_once || !Stream::Output.is_terminal();
    let settings = Settings::of(&arguments.options)?;
    let clock = if is_once { ClockKind::Stepped } else { ClockKind::Real };
    let bus = settings.open_bus(context, clock)?;
    let seconds = arguments.seconds.unwrap_or(1.0);
    if is_once && !is_asked_once {
        note(format_args!(
            "standard output is not a terminal: printing once after {seconds} s, as with --once"
        ));
    }
    let requirements = GatewayRequirements {
        is_listening: arguments.listen_only,
        ..GatewayRequirements::on(arguments.channel)
    };
    let mut source: Box<dyn Source + '_> = match bus.service().cloned() {
        Some(connection) => {
            let setup = &arguments.options.setup;
            Box::new(ServiceSource::open(bus, connection, (requirements, setup), !is_once)?)
        }
        None => {
            let global = context.global;
            Box::new(PortSource::open(&bus, &settings, requirements, &arguments.options, global)?)
        }
    };
    let signals = Arc::new(arguments.signals.read()?);
    let (view, sort, filter) = (arguments.view, arguments.sort, arguments.channel);
    let choice = Choice { view, sort, filter, ..Choice::default() };
    match is_once {
        true => print_once(source.as_mut(), seconds, choice, signals, &interrupt, context),
        false => terminal::run(source.as_mut(), choice, signals, &interrupt, &context.output),
    }
}

fn print_once(
    source: &mut dyn Source,
    seconds: f64,
    choice: Choice,
    signals: Arc<Signals>,
    interrupt: &Interrupt,
    context: &Context,
) -> Result {
    source.enter_thread()?;
    let length_ns = (seconds * 1e9) as u64;
    let mut collector = Collector::new(source.origin(), length_ns);
    source.start()?;
    observe_while(source, &mut collector, interrupt, |source| source.is_starting())?;
    let end_ns = source.now_ns().saturating_add(length_ns);
    observe_while(source, &mut collector, interrupt, |source| source.now_ns() < end_ns)?;
    let read = source.read_errors().map(|errors| {
        errors.into_iter().for_each(|(position, errors)| collector.take_errors(position, errors));
    });
    let service_events = source.service_events();
    let snapshot = Snapshot { signals, service_events, ..collector.snapshot() };
    print(&snapshot, choice, context)?;
    let Head { frames_lost, interruption, .. } = &snapshot.head;
    if *frames_lost > 0 {
        note(format_args!("{frames_lost} frames lost: this program reads too slowly"));
    }
    interruption
        .iter()
        .for_each(|interruption| note(format_args!("the values are old: {interruption}")));
    read?;
    if snapshot.has_problem() { Err(Failure::ProblemsFound) } else { Ok(()) }
}

/// Observes until the condition is false or the user stops.
fn observe_while(
    source: &mut dyn Source,
    collector: &mut Collector,
    interrupt: &Interrupt,
    is_wanted: impl Fn(&dyn Source) -> bool,
) -> Result {
    let mut observation = source.observation();
    let mut look = |source: &mut dyn Source, observation: &mut Observation| -> Result {
        source.look(observation)?;
        collector.take(observation);
        observation.clear();
        Ok(())
    };
    look(source, &mut observation)?;
    let mut look_ns = 0;
    while is_wanted(source) && !interrupt.is_set() {
        source.observe(&mut observation)?;
        if source.now_ns() >= look_ns || observation.is_nearly_full() {
            look_ns = source.now_ns().saturating_add(LOOK_NS);
            look(source, &mut observation)?;
        }
    }
    look(source, &mut observation)
}

fn print(snapshot: &Snapshot, choice: Choice, context: &Context) -> Result {
    let (output, head) = (&context.output, &snapshot.head);
    match choice.view {
        View::Overview => output.data(snapshot, |out| text::print_overview(out, snapshot)),
        View::Ids => {
            let ids = choice.ids(snapshot).into_iter().map(|row| IdReport {
                row,
                decoded: snapshot.signals.decode(row.channel, &row.frame).map(Into::into),
            });
            let view = IdsReport { not_listed: snapshot.ids.not_listed, ids: ids.collect() };
            let report = ViewReport { head, view: &view };
            output.data(&report, |out| text::print_ids(out, snapshot, choice))
        }
        View::Axes => {
            let report = ViewReport { head, view: &snapshot.axes };
            output.data(&report, |out| text::print_axes(out, &snapshot.axes))
        }
    }
}
