//! `ecan send`: cansend through a gateway.

use clap::Args;
use ecan_can_io::candump::{FrameText, parse_frame};
use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::Direction;
use ecan_protocol::text::Printable;
use ecan_tool_support::command_line::options::{ANY_TIME, milliseconds};
use serde::Serialize;

use crate::context::{Context, Failure, Result};
use crate::frames::signals::{self, DecodedMessage};
use crate::frames::{
    Channels, DbcOption, Due, FrameOptions, GatewayRequirements, Prepared, Record, Sender, Service,
    Signals, TransmitTracker, names_channel, parse_channel,
};

pub const EXAMPLES: &str = "\
Examples:
  ecan send 123#DEADBEEF                       a CAN ID of 8 digits is extended
  ecan send --channel 1 000#0101 123#R4        several frames; R is a remote frame
  ecan send --data-bitrate 2000000 123##1AABB  CAN FD; 1 is the bit rate switch, 2 ESI
  ecan send --config cell.toml 123#01          with the bit rates of a configuration file
  ecan send --dbc cell.dbc Lights Front=On Level=80    a message of a DBC file by its signals

A message name is followed by its signals; a value is a number in the signal's unit, or a text of the
file. Signals that are not given have their start value (GenSigStartValue), else the raw value 0.

The command exits when the gateway has sent the frames, that is, another node has acknowledged them.";

#[derive(Debug, Args)]
pub struct SendArguments {
    /// ID#DATA, ID#R[LENGTH], ID##FLAGS[DATA] as for cansend; or MESSAGE SIGNAL=VALUE
    #[arg(value_name = "FRAME", required = true, value_parser = parse)]
    frames: Vec<Word>,
    /// CAN channel, 0 to 3
    #[arg(long, value_name = "N", default_value = "0", value_parser = parse_channel)]
    channel: u8,
    /// Time limit for the transmission
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = milliseconds::<u64>(ANY_TIME))]
    timeout: u64,
    #[command(flatten)]
    signals: DbcOption,
    #[command(flatten)]
    options: FrameOptions,
}

/// Positional argument.
#[derive(Clone, Debug)]
enum Word {
    Frame(CanFrame),
    /// Name of a message of a DBC file.
    Message(String),
    /// Signal of the message before, and its value.
    Signal(String, String),
}

/// Parses a frame, a message or a signal; dots between bytes are allowed, as in cansend.
fn parse(text: &str) -> Result<Word, String> {
    if names_channel(text) {
        return Err("the name of a channel is no frame; expected ID#DATA".to_owned());
    }
    let is_name = |text: &str| {
        let is_inner = |character: char| character.is_ascii_alphanumeric() || character == '_';
        text.chars().all(is_inner)
            && !text.starts_with(|character: char| character.is_ascii_digit())
    };
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() && !text.contains('#') => {
            Ok(Word::Signal(name.to_owned(), value.to_owned()))
        }
        None if is_name(text) && !text.is_empty() => Ok(Word::Message(text.to_owned())),
        _ => {
            let frame = parse_frame(&text.replace('.', ""));
            frame.map(Word::Frame).map_err(|error| match text.strip_prefix("0x") {
                Some(rest) if parse_frame(rest).is_ok() => {
                    format!("an ID has no prefix: {}", Printable(rest))
                }
                _ => error.to_string(),
            })
        }
    }
}

/// Frames of the arguments.
fn frames(words: &[Word], signals: &Signals, channel: u8) -> Result<Vec<CanFrame>> {
    let mut frames = Vec::new();
    let mut words = words.iter().peekable();
    while let Some(word) = words.next() {
        let name = match word {
            Word::Frame(frame) => {
                frames.push(*frame);
                continue;
            }
            Word::Signal(name, value) => {
                let message =
                    format!("{name}={value} follows no message; give MESSAGE {name}={value}");
                return Err(Failure::Usage(message));
            }
            Word::Message(name) => name,
        };
        if signals.is_empty() {
            let message = format!("message {name} needs --dbc FILE; a frame is ID#DATA");
            return Err(Failure::Usage(message));
        }
        let mut values = Vec::new();
        while let Some(Word::Signal(name, value)) = words.peek() {
            values.push((name.as_str(), value.as_str()));
            words.next();
        }
        let usage = |error: &dyn ToString| Failure::Usage(error.to_string());
        let message = signals.message(channel, name).map_err(|error| usage(&error))?;
        frames.push(message.encode(&values).map_err(|error| usage(&error))?);
    }
    Ok(frames)
}

#[derive(Debug, Serialize)]
struct Sent {
    channel: u8,
    frames: Vec<String>,
    /// Messages of the frames, with DBC files; `null` for a frame of no message.
    #[serde(skip_serializing_if = "Option::is_none")]
    messages: Option<Vec<Option<DecodedMessage>>>,
}

pub fn run(arguments: &SendArguments, context: &Context) -> Result {
    let SendArguments { channel, options, .. } = arguments;
    let signals = arguments.signals.read()?;
    let frames = frames(&arguments.frames, &signals, *channel)?;
    let context = &context.on_stderr(options.capture.is_on_output());
    let channels = Channels::only(*channel);
    let requirements = GatewayRequirements {
        directions: &[Direction::RxPdo],
        has_results: true,
        ..GatewayRequirements::on(channels)
    };
    let prepared = Prepared::new(options, requirements, context)?;
    if let Some(fd) = frames.iter().find(|frame| frame.as_ref().is_fd()) {
        prepared.needs_fd(format_args!("{} is a CAN FD frame", FrameText(fd)), *channel)?;
    }
    let Some(mut service) = prepared.enter_ready()? else {
        return Err(Failure::Incomplete("stopped before a frame was sent".to_owned()));
    };
    let timeout_ns = arguments.timeout.saturating_mul(1_000_000);
    let mut sender = Sender { channels, timeout_ns, record: Record::Nothing };
    let due = |frame: &CanFrame| Ok(Due { after_ns: 0, channel: *channel, frame: *frame });
    let (tracker, outcome) = sender.send(&mut service, frames.iter().map(due));
    outcome.and(service.finish())?;
    check_sent(arguments, &frames, &tracker, &service)?;
    let texts: Vec<_> = frames.iter().map(|frame| FrameText(frame).to_string()).collect();
    let decoded: Vec<_> = frames.iter().map(|frame| signals.decode(*channel, frame)).collect();
    let messages = || decoded.iter().map(|message| message.clone().map(Into::into)).collect();
    let messages = (!signals.is_empty()).then(messages);
    let sent = Sent { channel: *channel, frames: texts, messages };
    context.output.data(&sent, |out| {
        sent.frames.iter().zip(&decoded).try_for_each(|(frame, decoded)| {
            writeln!(out, "can{channel} {frame} sent")?;
            let mut lines = decoded.iter().flat_map(signals::lines);
            lines.try_for_each(|line| writeln!(out, "{line}"))
        })
    })
}

fn check_sent(
    arguments: &SendArguments,
    frames: &[CanFrame],
    tracker: &TransmitTracker,
    service: &Service,
) -> Result {
    let SendArguments { channel, timeout, .. } = arguments;
    let outcome = tracker.outcome();
    let count = frames.len() as u64;
    if let Some((number, code)) = tracker.first_failure() {
        let frame = usize::try_from(number).ok().and_then(|number| frames.get(number));
        let text = frame.map_or_else(String::new, |frame| FrameText(frame).to_string());
        let message = format!("channel {channel} of the gateway rejected {text}: {code}");
        return Err(Failure::Incomplete(message));
    }
    if outcome.sent >= count && outcome.bus_off.is_none() {
        return Ok(());
    }
    let otherwise = match outcome.unknown {
        0 => "stopped, or not accepted by the gateway in time",
        _ => "transmit result unknown",
    };
    let message = match count.saturating_sub(outcome.sent) {
        0 => "transmission of the frames is not confirmed".to_owned(),
        behind => format!("{behind} of {count} frames not sent within {timeout} ms"),
    };
    Err(tracker.failure(service, message, Some(otherwise)))
}
