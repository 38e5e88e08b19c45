//! Sends the frames of a test and compares the received frames.

use ecan_diagnosis::registers::{ErrorCounters, LastErrorCode, ProtocolStatus};
use ecan_mcan_port::Received;
use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::CHANNELS;
use serde::Serialize;

use crate::context::{Failure, Result};
use crate::frames::Service;

use super::frames::{difference, frame, origin};

/// Time without progress that ends a test, in ns; a frame of 64 bytes takes 6 ms at 125 kbit/s.
const STANDSTILL_NS: u64 = 500_000_000;
/// Cycles to wait for further frames after the last one.
const QUIET_CYCLES: u32 = 20;

/// Route from one channel to another, or to itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Route {
    pub(super) from: u8,
    pub(super) to: u8,
}

#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub(super) struct Counts {
    pub(super) sent: u32,
    /// Frames received unchanged.
    pub(super) received: u32,
    /// Frames received with other contents.
    pub(super) wrong: u32,
    pub(super) repeated: u32,
    /// Received frames that the test did not send.
    pub(super) strange: u32,
    pub(super) first_wrong: Option<String>,
}

/// Error counters and status of a channel (0x9000, manual 13.5).
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct ChannelState {
    pub(super) channel: u8,
    pub(super) counters: ErrorCounters,
    pub(super) status: ProtocolStatus,
    /// Frames dropped before packing, :13.
    pub(super) dropped: u32,
    /// Number of bus-offs, :15.
    pub(super) bus_off_count: u32,
}

impl ChannelState {
    fn read(
        channel: u8,
        mut upload: impl FnMut(u16, u8) -> Result<u32, ecan_host::Error>,
    ) -> Result<Self, ecan_host::Error> {
        let mut get = |subindex| upload(0x9000 + u16::from(channel), subindex);
        Ok(Self {
            channel,
            counters: ErrorCounters::from_raw(get(1)?),
            status: ProtocolStatus::from_raw(get(2)?),
            dropped: get(13)?,
            bus_off_count: get(15)?,
        })
    }

    /// Returns whether frames get no acknowledgement: the counter of a channel alone on its bus
    /// stops at 128, error passive.
    pub(super) fn is_unheard(&self) -> bool {
        let is_alone = self.counters.transmit == 128 && !self.status.is_bus_off;
        is_alone || self.status.last_error == LastErrorCode::Acknowledge
    }

    pub(super) fn faults(&self, before: &Self) -> Vec<String> {
        let Self { channel, counters, status, .. } = self;
        let mut faults = Vec::new();
        let times = self.bus_off_count.wrapping_sub(before.bus_off_count);
        if status.is_bus_off || times > 0 {
            faults.push(format!("channel {channel} went bus-off"));
        }
        let ErrorCounters { transmit, receive, logged, .. } = *counters;
        if transmit > 0 || receive > 0 || logged > 0 {
            let mut message = format!("channel {channel}: error counters {counters}");
            if status.last_error.is_error() {
                message.push_str(&format!(", last error {}", status.last_error));
            }
            faults.push(message);
        }
        let dropped = self.dropped.wrapping_sub(before.dropped);
        if dropped > 0 {
            faults.push(format!("channel {channel} dropped {dropped} frames"));
        }
        faults
    }
}

pub(super) fn states(service: &mut Service, channels: &[u8]) -> Result<Vec<ChannelState>> {
    let channels = channels.to_vec();
    let read = service.port_mut().diagnose(move |diagnostics| {
        let read = |channel| {
            ChannelState::read(channel, |index, sub| diagnostics.sdo_upload_u32(0, index, sub))
        };
        channels.into_iter().map(read).collect::<Result<Vec<_>, _>>()
    });
    match read {
        Ok(states) => states.map_err(Failure::Device),
        Err(error) => Err(Failure::Rejected(error.to_string())),
    }
}

struct Traffic {
    route: Route,
    frames: Vec<CanFrame>,
    has_come: Vec<bool>,
    counts: Counts,
}

impl Traffic {
    fn next(&self) -> Option<&CanFrame> {
        self.frames.get(self.counts.sent as usize)
    }

    fn is_complete(&self) -> bool {
        self.has_come.iter().all(|has_come| *has_come)
    }

    /// Handles a frame received on the route's channel, if it belongs to the route.
    fn take(&mut self, came: &CanFrame) -> bool {
        let Some((_, number)) = origin(came).filter(|(from, _)| *from == self.route.from) else {
            return false;
        };
        let number = usize::from(number);
        let (Some(sent), Some(has_come)) = (self.frames.get(number), self.has_come.get_mut(number))
        else {
            return false;
        };
        if number >= self.counts.sent as usize {
            return false;
        }
        let is_repeated = std::mem::replace(has_come, true);
        match difference(sent, came) {
            Some(message) => {
                self.counts.wrong += 1;
                self.counts.first_wrong.get_or_insert(message);
            }
            None if is_repeated => self.counts.repeated += 1,
            None => self.counts.received += 1,
        }
        true
    }
}

/// Sends `count` frames on every route in parallel; returns when all are received and no frame
/// follows, or without progress. `None` if the user stops.
pub(super) fn exchange(
    service: &mut Service,
    routes: &[Route],
    count: u16,
    is_fd: bool,
) -> Result<Option<Vec<Counts>>> {
    let mut traffics = Vec::new();
    for route in routes {
        let frames = (0..count).map(|number| frame(route.from, number, is_fd));
        let frames = frames.collect::<Result<Vec<_>, _>>();
        let frames = frames.map_err(|error| Failure::Usage(error.to_string()))?;
        let has_come = vec![false; frames.len()];
        traffics.push(Traffic { route: *route, frames, has_come, counts: Counts::default() });
    }
    let (mut quiet, mut last_ns) = (0, service.now_ns());
    while quiet < QUIET_CYCLES {
        if service.is_interrupted() {
            return Ok(None);
        }
        let cycle = service.begin();
        quiet = if traffics.iter().all(Traffic::is_complete) { quiet + 1 } else { 0 };
        for arrival in &cycle.arrivals {
            let Received::Frame(received) = &arrival.received else { continue };
            let on_channel = |traffic: &&mut Traffic| traffic.route.to == received.channel;
            let Some(traffic) = traffics.iter_mut().find(on_channel) else { continue };
            match traffic.take(&received.frame) {
                true => last_ns = cycle.now_ns,
                false => traffic.counts.strange += 1,
            }
        }
        // In turn, so that no channel fills the whole image.
        let mut is_open = [true; CHANNELS];
        while is_open.contains(&true) {
            for (traffic, is_open) in traffics.iter_mut().zip(&mut is_open) {
                let taken = match traffic.next() {
                    Some(frame) => service.send(traffic.route.from, frame)?.is_some(),
                    None => false,
                };
                traffic.counts.sent += u32::from(taken);
                *is_open = taken;
                if taken {
                    last_ns = cycle.now_ns;
                }
            }
            is_open.iter_mut().skip(traffics.len()).for_each(|it| *it = false);
        }
        let is_over = cycle.now_ns.saturating_sub(last_ns) >= STANDSTILL_NS;
        service.end(cycle)?;
        if is_over {
            break;
        }
    }
    Ok(Some(traffics.into_iter().map(|traffic| traffic.counts).collect()))
}
