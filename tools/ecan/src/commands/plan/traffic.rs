//! The traffic of a plan: so many frames a cycle, or those of a recording.

use std::path::Path;

use ecan_candump::ParseErrorKind;
use ecan_mcan_port::{FrameRate, FrameStream};
use ecan_protocol::{CHANNELS, CanFrame, CanId};

use crate::failure::Failure;

use super::{Channels, PlanArguments};

/// Identifier of frames that are no recorded ones.
const FRAME_ID: u16 = 0x123;

/// What is sent, and the same coming back.
pub(super) fn of(arguments: &PlanArguments) -> Result<Vec<FrameStream>, Failure> {
    let sent = match &arguments.replay {
        Some(path) => recorded(path, arguments.channel, arguments.slaves.into())?,
        None => even(arguments)?,
    };
    let back = sent.iter().map(|it| FrameStream::from_bus(it.slave, it.channel, it.frame, it.rate));
    let back: Vec<_> = back.collect();
    Ok([sent, back].concat())
}

fn even(arguments: &PlanArguments) -> Result<Vec<FrameStream>, Failure> {
    let is_fd = arguments.fd.is_some();
    let bytes = arguments.bytes.unwrap_or(if is_fd { 64 } else { 8 });
    let wrong = |error: &dyn std::fmt::Display| {
        Failure::Usage(format!("a frame of {bytes} bytes: {error}"))
    };
    let id = CanId::standard(FRAME_ID).map_err(|error| wrong(&error))?;
    let data = vec![0; usize::from(bytes)];
    let frame = match is_fd {
        true => CanFrame::fd(id, &data, true, false),
        false => CanFrame::classic(id, &data),
    };
    let frame = frame.map_err(|error| wrong(&error))?;
    let rate = FrameRate::PerCycle(arguments.frames);
    let channels = match arguments.channel {
        Channels::One(channel) => channel..=channel,
        Channels::All => 0..=CHANNELS as u8 - 1,
    };
    let slaves = 0..usize::from(arguments.slaves);
    Ok(slaves
        .flat_map(|slave| channels.clone().map(move |channel| (slave, channel)))
        .map(|(slave, channel)| FrameStream::to_bus(slave, channel, frame, rate))
        .collect())
}

/// Frames of one length and format on a channel.
struct Alike {
    /// Channel, counted over all gateways.
    place: usize,
    first: CanFrame,
    count: u32,
}

fn recorded(path: &Path, channels: Channels, slaves: usize) -> Result<Vec<FrameStream>, Failure> {
    let failure = |what, reason| Failure::File { what, path: path.to_owned(), reason };
    let text = std::fs::read_to_string(path).map_err(|error| failure("read", error.to_string()))?;
    let mut groups: Vec<Alike> = Vec::new();
    let mut times = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let record = match ecan_candump::parse_line(line) {
            Ok(Some(record)) => record,
            Ok(None) => continue,
            // Of the interface, not of the bus.
            Err(error) if error.kind == ParseErrorKind::ErrorMessage => continue,
            Err(error) => return Err(failure("understand", format!("line {number}, {error}"))),
        };
        times.push(record.time_ns);
        let place = place(channels, slaves, record.interface);
        let form = |frame: &CanFrame| (frame.kind(), frame.len(), frame.id().is_extended());
        let is_like = |it: &&mut Alike| it.place == place && form(&it.first) == form(&record.frame);
        match groups.iter_mut().find(is_like) {
            Some(group) => group.count += 1,
            None => groups.push(Alike { place, first: record.frame, count: 1 }),
        }
    }
    let (Some(first), Some(last)) = (times.first(), times.last()) else {
        return Err(failure("understand", "it holds no frame".to_owned()));
    };
    let seconds = last.saturating_sub(*first) as f64 / 1e9;
    let stream = |group: &Alike| {
        let rate = if seconds > 0.0 {
            FrameRate::PerSecond(f64::from(group.count) / seconds)
        } else {
            FrameRate::PerCycle(group.count)
        };
        let (slave, channel) = (group.place / CHANNELS, (group.place % CHANNELS) as u8);
        FrameStream::to_bus(slave, channel, group.first, rate)
    };
    Ok(groups.iter().map(stream).collect())
}

/// Where a recorded frame goes: `canN` to channel N over all gateways when all are used.
fn place(channels: Channels, slaves: usize, interface: &str) -> usize {
    match channels {
        Channels::One(channel) => channel.into(),
        Channels::All => {
            let digits = interface.trim_start_matches(|c: char| !c.is_ascii_digit());
            digits.parse::<usize>().unwrap_or(0) % (slaves * CHANNELS).max(1)
        }
    }
}
