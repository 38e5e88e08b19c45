//! Traffic of a plan: a number of frames per cycle, or a recording.

use std::path::Path;

use ecan_can_io::recording::ReadOptions;
use ecan_mcan_port::{FrameRate, FrameStream};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::mapping::Direction;

use crate::context::{Failure, Result};
use crate::frames::recording::{self, Recorded};

use super::{PlanArguments, Planned};

const FRAME_ID: u16 = 0x123;

/// Traffic sent; the same amount is received. Channels of one direction have traffic in that one.
pub(super) fn of(arguments: &PlanArguments, planned: &Planned) -> Result<Vec<FrameStream>> {
    let carries = |it: &FrameStream, direction| {
        let gateway = planned.port.gateways.get(it.slave);
        gateway.is_some_and(|gateway| gateway.carries(direction, it.channel))
    };
    let (all, sent) = match &arguments.replay {
        Some(path) => {
            let sent = recorded(path, planned)?;
            (sent.clone(), sent)
        }
        None => {
            let all = even(arguments, planned)?;
            let sends = |it: &&FrameStream| carries(it, Direction::RxPdo);
            let sent = all.iter().filter(sends).copied().collect();
            (all, sent)
        }
    };
    let back = all.iter().filter(|it| carries(it, Direction::TxPdo));
    let back = back.map(|it| FrameStream::from_bus(it.slave, it.channel, it.frame, it.rate));
    let back: Vec<_> = back.collect();
    Ok([sent, back].concat())
}

fn even(arguments: &PlanArguments, planned: &Planned) -> Result<Vec<FrameStream>> {
    let rate = FrameRate::PerCycle(arguments.frames);
    let mut streams = Vec::new();
    for (slave, gateway) in planned.port.gateways.iter().enumerate() {
        for (channel, settings) in (0..).zip(&gateway.channels) {
            let Some(settings) = settings else { continue };
            if planned.channels.contains(channel) {
                let frame = frame(settings.can.fd, arguments.bytes)?;
                streams.push(FrameStream::to_bus(slave, channel, frame, rate));
            }
        }
    }
    match streams.is_empty() {
        false => Ok(streams),
        true => Err(Failure::Usage("no gateway has one of the selected channels".to_owned())),
    }
}

fn frame(is_fd: bool, bytes: Option<u8>) -> Result<CanFrame> {
    let bytes = bytes.unwrap_or(if is_fd { 64 } else { 8 });
    let wrong = |error: &dyn std::fmt::Display| {
        Failure::Usage(format!("a frame of {bytes} bytes: {error}"))
    };
    let id = CanId::standard(FRAME_ID).map_err(|error| wrong(&error))?;
    let data = vec![0; usize::from(bytes)];
    let frame = match is_fd {
        true => CanFrame::fd(id, &data, true, false),
        false => CanFrame::classic(id, &data),
    };
    frame.map_err(|error| wrong(&error))
}

/// Frames of one length and format on a channel.
struct TrafficGroup {
    first: Recorded,
    count: u32,
}

fn recorded(path: &Path, planned: &Planned) -> Result<Vec<FrameStream>> {
    let gateways = planned.port.gateways.len();
    let frames = recording::read(path, &ReadOptions::default(), planned.channels, gateways)?.frames;
    let times = || frames.iter().map(|it| it.logged.time_ns);
    let (first_ns, last_ns) = (times().min().unwrap_or(0), times().max().unwrap_or(0));
    let form = |it: &Recorded| {
        let frame = &it.logged.frame;
        (it.gateway, it.channel, frame.kind(), frame.len(), frame.id().is_extended())
    };
    let mut groups: Vec<TrafficGroup> = Vec::new();
    for frame in frames {
        match groups.iter_mut().find(|it| form(&it.first) == form(&frame)) {
            Some(group) => group.count += 1,
            None => groups.push(TrafficGroup { first: frame, count: 1 }),
        }
    }
    let seconds = last_ns.saturating_sub(first_ns) as f64 / 1e9;
    let stream = |TrafficGroup { first, count }: TrafficGroup| {
        let rate = if seconds > 0.0 {
            FrameRate::PerSecond(f64::from(count) / seconds)
        } else {
            FrameRate::PerCycle(count)
        };
        FrameStream::to_bus(first.gateway, first.channel, first.logged.frame, rate)
    };
    Ok(groups.into_iter().map(stream).collect())
}
