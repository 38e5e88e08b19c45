//! `ecan send`: cansend through a gateway.

use clap::Args;
use ecan_candump::{FrameText, parse_frame};
use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::Direction;
use serde::Serialize;

use crate::context::{Context, Failure, Result};
use crate::frames::{
    Channels, Due, FrameOptions, GatewayRequirements, Prepared, Record, Sender, Service,
    TransmitTracker, names_channel, parse_channel,
};

pub const EXAMPLES: &str = "\
Examples:
  ecan send 123#DEADBEEF                       a CAN ID of 8 digits is extended
  ecan send --channel 1 000#0101 123#R4        several frames; R is a remote frame
  ecan send --data-bitrate 2000000 123##1AABB  CAN FD; 1 is the bit rate switch, 2 ESI
  ecan send --config cell.toml 123#01          with the bit rates of a configuration file

The command exits when the gateway has sent the frames, that is, another node has acknowledged them.";

#[derive(Debug, Args)]
pub struct SendArguments {
    /// Frames in the format of cansend: ID#DATA, ID#R[LENGTH], ID##FLAGS[DATA]
    #[arg(value_name = "FRAME", required = true, value_parser = parse)]
    frames: Vec<CanFrame>,
    /// CAN channel, 0 to 3
    #[arg(long, value_name = "N", default_value = "0", value_parser = parse_channel)]
    channel: u8,
    /// Time limit for the transmission, in ms
    #[arg(long, value_name = "MS", default_value_t = 1000)]
    timeout: u64,
    #[command(flatten)]
    options: FrameOptions,
}

/// Parses a frame; dots between bytes are allowed, as in cansend.
fn parse(text: &str) -> Result<CanFrame, String> {
    if names_channel(text) {
        return Err(format!("use --channel {text} to select a channel"));
    }
    parse_frame(&text.replace('.', "")).map_err(|error| error.to_string())
}

#[derive(Debug, Serialize)]
struct Sent {
    channel: u8,
    frames: Vec<String>,
}

pub fn run(arguments: &SendArguments, context: &Context) -> Result {
    let SendArguments { frames, channel, options, .. } = arguments;
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
    let Some(mut service) = prepared.enter()? else {
        return Err(Failure::Incomplete("stopped before a frame was sent".to_owned()));
    };
    let timeout_ns = arguments.timeout.saturating_mul(1_000_000);
    let mut sender = Sender { channels, timeout_ns, record: Record::Nothing };
    let due = |frame: &CanFrame| Ok(Due { after_ns: 0, channel: *channel, frame: *frame });
    let (tracker, outcome) = sender.send(&mut service, frames.iter().map(due));
    outcome.and(service.finish())?;
    check_sent(arguments, &tracker, &service)?;
    let texts: Vec<_> = frames.iter().map(|frame| FrameText(frame).to_string()).collect();
    let sent = Sent { channel: *channel, frames: texts };
    context.output.data(&sent, |out| {
        sent.frames.iter().try_for_each(|frame| writeln!(out, "can{channel} {frame} sent"))
    })
}

fn check_sent(arguments: &SendArguments, tracker: &TransmitTracker, service: &Service) -> Result {
    let SendArguments { frames, channel, timeout, .. } = arguments;
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
