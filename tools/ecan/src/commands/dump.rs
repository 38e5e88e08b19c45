//! `ecan dump`: candump through a gateway.

use std::path::PathBuf;
use std::sync::Arc;

use clap::{ArgGroup, Args};
use ecan_can_io::candump::Filter;
use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::Direction;
use ecan_tool_support::command_line::new_file::is_standard_stream;
use ecan_tool_support::command_line::options::{ANY_TIME, milliseconds};

use crate::context::{Context, Failure, Result, note};
use crate::frames::{
    Channels, DbcOption, Destination, Event, FrameOptions, GatewayRequirements, Prepared, Printer,
    Screen, Service, Style, TimedFrame, names_channel,
};

pub const EXAMPLES: &str = "\
Examples:
  ecan dump --bitrate 1M                       everything on all channels
  ecan dump --channel 0 -t a 123:7FF           CAN ID 123 on channel 0, with time stamps
  ecan dump --listen-only -l drive.log         record without acknowledging
  ecan dump --config cell.toml --channel 1     with the settings of a configuration file
  ecan dump --dbc cell.dbc                     with the signals of each frame
  ecan dump --dbc 0=drive.dbc --dbc 1=io.dbc   a DBC file for each channel
  ecan dump --capture bus.pcapng               write a file for Wireshark
  ecan dump --capture - | wireshark -k -i -    show live in Wireshark
  ecan dump -n 1 -T 500 701:7FF || echo quiet  wait half a second for a heartbeat

Filters are hexadecimal. ID:MASK passes frames whose CAN ID equals ID in the bits of MASK, ID~MASK
passes the others. A frame is printed if one filter passes it; with j, if all pass it. An ID of 8
digits is extended.

With -T the exit status is 1 if fewer frames than -n are received, or none without -n.";

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
    /// Exit if no frame is received for this time
    #[arg(short = 'T', long, value_name = "TIME", value_parser = milliseconds::<u64>(ANY_TIME))]
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
    /// Write a candump log, or BLF with the name *.blf; print nothing unless --screen is given; - is stdout
    #[arg(short = 'l', long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Print in the format of the log
    #[arg(short = 'L', long, conflicts_with_all = ["ascii", "device_time", "dbc"])]
    log_format: bool,
    /// Print the frames in addition to --record or --capture
    #[arg(long, requires = "file")]
    screen: bool,
    #[command(flatten)]
    signals: DbcOption,
    #[command(flatten)]
    options: FrameOptions,
}

/// Positional argument: a filter, or `None` for `j`.
#[derive(Clone, Copy, Debug)]
struct Rule(Option<Filter>);

fn parse_rule(text: &str) -> Result<Rule, String> {
    match text {
        "j" | "J" => Ok(Rule(None)),
        name if names_channel(name) => {
            Err("the name of a channel is no filter; expected ID:MASK".to_owned())
        }
        text => text.parse().map(|filter| Rule(Some(filter))).map_err(|error| format!("{error}")),
    }
}

pub fn run(arguments: &DumpArguments, context: &Context) -> Result {
    let capture = &arguments.options.capture;
    let log = arguments.record.as_deref();
    capture.check_apart_from(log)?;
    let is_filed = log.is_some() || capture.path().is_some();
    let is_on_output = capture.is_on_output() || log.is_some_and(is_standard_stream);
    if arguments.screen && is_on_output {
        let message = "--screen and a file on standard output exclude each other";
        return Err(Failure::Usage(message.to_owned()));
    }
    let context = &context.on_stderr(is_on_output);
    let screen = Screen {
        style: arguments.time,
        has_nanoseconds: arguments.nanoseconds,
        has_ascii: arguments.ascii,
        has_extra: arguments.extra,
        is_log: arguments.log_format,
        is_json: context.global.json,
        signals: Arc::new(arguments.signals.read()?),
    };
    let requirements = GatewayRequirements {
        directions: &[Direction::TxPdo],
        is_listening: arguments.listen_only,
        has_device_time: arguments.device_time,
        has_end: arguments.count.is_some() || arguments.timeout.is_some(),
        ..GatewayRequirements::on(arguments.channel)
    };
    let prepared = Prepared::new(&arguments.options, requirements, context)?;
    let is_shown = !is_filed || arguments.screen;
    let destination = Destination { is_shown, log, existing: capture.existing() };
    let mut printer = Printer::start(screen, destination, &prepared.interrupt)?;
    let received = match prepared.enter()? {
        Some(service) => receive(arguments, service, &mut printer),
        None => Ok(()),
    };
    let printed = printer.finish();
    received.and(printed)
}

fn receive(arguments: &DumpArguments, mut service: Service, printer: &mut Printer) -> Result {
    let filters: Vec<_> = arguments.rules.iter().filter_map(|rule| rule.0).collect();
    let needs_all = filters.len() != arguments.rules.len();
    let passes = |frame: &CanFrame| {
        let mut passed = filters.iter().map(|filter| filter.passes(frame));
        if needs_all {
            passed.all(|passes| passes)
        } else {
            filters.is_empty() || passed.any(|passes| passes)
        }
    };
    let timeout_ns = arguments.timeout.map(|ms| ms.saturating_mul(1_000_000));
    let (mut count, mut last_ns) = (0, service.observed_ns());
    loop {
        let cycle = service.begin_with(|received| {
            let is_selected = passes(&received.frame) && Some(count) != arguments.count;
            count += u64::from(is_selected);
            is_selected
        });
        for arrival in &cycle.arrivals {
            let Event::Frame(frame) = arrival.event else { continue };
            last_ns = service.observed_ns();
            let time_ns = service.absolute_ns(arrival.time_ns);
            let gap = service.take_gap(frame.gateway);
            printer.put(TimedFrame { time_ns, frame, gap }, service.is_real_time());
        }
        let is_quiet = timeout_ns.is_some_and(|limit| service.observed_ns() - last_ns >= limit);
        let ended = service.end(cycle);
        let is_complete = Some(count) == arguments.count;
        if service.is_interrupted() && count == 0 {
            note(format_args!("# {}", service.silence()));
        }
        if ended.is_err() || is_complete || service.is_interrupted() || printer.is_over() {
            return ended.and(service.finish());
        }
        if is_quiet {
            service.finish()?;
            return check_count(count, arguments.count.unwrap_or(1), &service);
        }
    }
}

fn check_count(received: u64, required: u64, service: &Service) -> Result {
    let text = match received {
        enough if enough >= required => return Ok(()),
        0 => service.silence(),
        few => format!("{few} of {required} frames received"),
    };
    match service.is_ready(0) {
        true => Err(Failure::Incomplete(text)),
        false => Err(service.not_ready(0, &text)),
    }
}
