//! `ecan dump`: candump through a gateway.

use std::path::PathBuf;

use clap::{ArgGroup, Args};
use ecan_candump::Filter;
use ecan_command_line::interrupt::Interrupt;
use ecan_command_line::new_file::is_standard_stream;
use ecan_mcan_port::{Received, Session};

use crate::failure::Failure;
use crate::frames::channels::{Channels, names_channel};
use crate::frames::format::{Screen, TimedFrame};
use crate::frames::options::FrameOptions;
use crate::frames::prepared::Prepared;
use crate::frames::printer::{Destination, Printer};
use crate::frames::service::Service;
use crate::frames::settings::{GatewayRequirements, Settings};
use crate::frames::single_gateway::session;
use crate::frames::timestamp::Style;
use crate::global::GlobalOptions;
use crate::output::Output;

/// Examples for the end of the help.
pub const EXAMPLES: &str = "\
Examples:
  ecan dump --bitrate 1000000                  everything on all channels
  ecan dump --channel 0 -t a 123:7FF           CAN ID 123 on channel 0, with time stamps
  ecan dump --listen-only -l drive.log         record without acknowledging
  ecan dump --config cell.toml --channel 1     with the settings of a configuration file
  ecan dump --capture bus.pcapng               write a file for Wireshark
  ecan dump --capture - | wireshark -k -i -    show live in Wireshark
  ecan dump -n 1 -T 500 701:7FF || echo quiet  wait half a second for a heartbeat

Filters are hexadecimal. ID:MASK passes frames whose CAN ID equals ID in the bits of MASK, ID~MASK
passes the others. A frame is printed if one filter passes it; with j, if all pass it. An ID of 8
digits is extended.

With -T the exit status is 1 if fewer frames than -n are received, or none without -n.";

/// Arguments of `dump`.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("file").multiple(true).args(["record", "capture"]))]
pub struct DumpArguments {
    /// Filters in hexadecimal, ID:MASK or ID~MASK; j passes frames that match all of them
    #[arg(value_name = "FILTER", value_delimiter = ',', value_parser = parse_rule)]
    rules: Vec<Rule>,
    /// Channels 0 to 3, comma-separated, or all
    #[arg(long, value_name = "CHANNELS", default_value = "all")]
    channel: Channels,
    /// Listen without acknowledging; another node must acknowledge
    #[arg(long)]
    listen_only: bool,
    /// Exit after this number of frames, at least 1
    #[arg(short = 'n', long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// Exit if no frame is received for this time, in ms
    #[arg(short = 'T', long, value_name = "MS")]
    timeout: Option<u64>,
    /// Time stamps: a absolute, d delta, z since the first frame, A with the date
    #[arg(short = 't', long, value_enum, value_name = "STYLE", ignore_case = false)]
    time: Option<Style>,
    /// Print time stamps in nanoseconds instead of microseconds
    #[arg(short = 'N', long)]
    nanoseconds: bool,
    /// Print the gateway's time stamp too, in raw units
    #[arg(short = 'H', long)]
    device_time: bool,
    /// Print the ASCII characters of the data
    #[arg(short = 'a', long)]
    ascii: bool,
    /// Print direction, bit rate switch and error state indicator
    #[arg(short = 'x', long)]
    extra: bool,
    /// Write a candump log and print nothing unless --screen is given; - is stdout
    #[arg(short = 'l', long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Print in the format of the log
    #[arg(short = 'L', long, conflicts_with_all = ["ascii", "device_time"])]
    log_format: bool,
    /// Print the frames in addition to --record or --capture
    #[arg(long, requires = "file")]
    screen: bool,
    #[command(flatten)]
    options: FrameOptions,
}

/// Positional argument: a filter or `j`.
#[derive(Clone, Copy, Debug)]
enum Rule {
    Filter(Filter),
    Join,
}

fn parse_rule(text: &str) -> Result<Rule, String> {
    match text {
        "j" | "J" => Ok(Rule::Join),
        name if names_channel(name) => Err(format!("use --channel {name} to select a channel")),
        text => text.parse().map(Rule::Filter).map_err(|error| format!("{error}")),
    }
}

/// Filters of the command line.
#[derive(Debug)]
struct Selection {
    filters: Vec<Filter>,
    needs_all: bool,
}

impl Selection {
    fn new(rules: &[Rule]) -> Self {
        let filters = rules.iter().filter_map(|rule| match rule {
            Rule::Filter(filter) => Some(*filter),
            Rule::Join => None,
        });
        let needs_all = rules.iter().any(|rule| matches!(rule, Rule::Join));
        Self { filters: filters.collect(), needs_all }
    }

    fn passes(&self, frame: &ecan_protocol::can::CanFrame) -> bool {
        let mut filters = self.filters.iter().map(|filter| filter.passes(frame));
        self.filters.is_empty()
            || if self.needs_all { filters.all(|it| it) } else { filters.any(|it| it) }
    }
}

pub fn run(
    arguments: &DumpArguments,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    let FrameOptions { capture, gateway } = &arguments.options;
    let log = arguments.record.as_deref();
    capture.check_apart_from(log)?;
    let is_filed = log.is_some() || capture.path().is_some();
    let is_on_output = capture.is_on_output() || log.is_some_and(is_standard_stream);
    if arguments.screen && is_on_output {
        let words = "--screen and a file on standard output exclude each other";
        return Err(Failure::Usage(words.to_owned()));
    }
    let settings = Settings::of(gateway)?;
    let interrupt = Interrupt::install()?;
    let screen = Screen {
        style: arguments.time,
        has_nanoseconds: arguments.nanoseconds,
        has_ascii: arguments.ascii,
        has_extra: arguments.extra,
        is_log: arguments.log_format,
        is_json: global.json,
    };
    let requirements = GatewayRequirements {
        is_listening: arguments.listen_only,
        has_device_time: arguments.device_time,
        has_end: arguments.count.is_some() || arguments.timeout.is_some(),
        ..GatewayRequirements::on(arguments.channel)
    };
    let prepared = Prepared::new(&settings, requirements, global, output)?;
    let is_shown = !is_filed || arguments.screen;
    let destination = Destination { is_shown, log, existing: capture.existing() };
    let mut printer = Printer::start(screen, destination, &interrupt)?;
    let service = prepared.enter(capture, &interrupt, output)?;
    let heard = match service {
        Some(service) => listen(arguments, service, &interrupt, &mut printer),
        None => Ok(()),
    };
    let printed = printer.finish(output);
    heard.and(printed)
}

/// Runs the cycle until enough frames are received.
fn listen(
    arguments: &DumpArguments,
    mut service: Service,
    interrupt: &Interrupt,
    printer: &mut Printer,
) -> Result<(), Failure> {
    let selection = Selection::new(&arguments.rules);
    let timeout_ns = arguments.timeout.map(|ms| ms.saturating_mul(1_000_000));
    let (mut heard, mut last_ns) = (0, service.now_ns());
    loop {
        let cycle = service.begin_with(|received| {
            let is_wanted = selection.passes(&received.frame) && Some(heard) != arguments.count;
            heard += u64::from(is_wanted);
            is_wanted
        });
        for arrival in &cycle.arrivals {
            let Received::Frame(received) = arrival.received else { continue };
            last_ns = arrival.time_ns;
            let time_ns = service.absolute_ns(arrival.time_ns);
            printer.put(TimedFrame { time_ns, received }, service.is_real_time());
        }
        let is_quiet = timeout_ns.is_some_and(|limit| cycle.now_ns - last_ns >= limit);
        let ended = service.end(cycle);
        let is_complete = Some(heard) == arguments.count;
        if interrupt.is_set() && heard == 0 {
            service.output().note(format_args!("# {}", service.silence()));
        }
        if ended.is_err() || is_complete || interrupt.is_set() || printer.is_over() {
            return ended.and(service.finish());
        }
        if is_quiet {
            service.finish()?;
            return judge(heard, arguments.count.unwrap_or(1), &service);
        }
    }
}

/// Checks whether enough frames were received.
fn judge(heard: u64, wanted: u64, service: &Service) -> Result<(), Failure> {
    let words = match heard {
        enough if enough >= wanted => return Ok(()),
        0 => service.silence(),
        few => format!("{few} of {wanted} frames received"),
    };
    match session(service.port()) {
        Session::Ready => Err(Failure::Incomplete(words)),
        _ => Err(service.not_ready(&words)),
    }
}
