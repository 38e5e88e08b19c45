//! Sends the frames of a test and compares the received frames.

use std::fmt::Display;

use ecan_diagnosis::registers::{ErrorCounters, LastErrorCode, ProtocolStatus};
use ecan_host::Error;
use ecan_mcan_port::{ChannelHandle, Cycle, ReceivedFrame, SendError};
use ecan_protocol::can::CanFrame;
use serde::Serialize;

use crate::context::{Failure, Result};

use super::frames::{difference, frame, origin};
use super::test_bus::TestBus;

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

/// Counters of a channel before a test (0x9000, manual 13.5).
#[derive(Clone, Copy, Debug)]
pub(super) struct ChannelCounters {
    dropped: u32,
    bus_off_count: u32,
}

impl ChannelCounters {
    pub(super) fn read(
        upload: impl Fn(u16, u8) -> Result<u32, Error>,
        channel: u8,
    ) -> Result<Self, Error> {
        let get = |subindex| upload(0x9000 + u16::from(channel), subindex);
        Ok(Self { dropped: get(13)?, bus_off_count: get(15)? })
    }
}

impl ChannelState {
    pub(super) fn read(
        upload: impl Fn(u16, u8) -> Result<u32, Error>,
        channel: u8,
    ) -> Result<Self, Error> {
        let get = |subindex| upload(0x9000 + u16::from(channel), subindex);
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

    pub(super) fn faults(&self, before: &ChannelCounters) -> Vec<String> {
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

/// Traffic of one gateway.
struct GatewayTraffic {
    gateway: usize,
    routes: Vec<Traffic>,
    channels: Vec<ChannelHandle>,
    /// Cycles since all frames were received.
    quiet: u32,
    last_ns: u64,
    is_over: bool,
}

impl GatewayTraffic {
    fn new(
        bus: &TestBus,
        gateway: usize,
        routes: &[Route],
        count: u16,
        is_fd: bool,
    ) -> Result<Self> {
        let wrong = |error: &dyn Display| Failure::Usage(error.to_string());
        let (mut traffics, mut channels) = (Vec::new(), Vec::new());
        for route in routes {
            let frames = (0..count).map(|number| frame(route.from, number, is_fd));
            let frames = frames.collect::<Result<Vec<_>, _>>().map_err(|error| wrong(&error))?;
            let has_come = vec![false; frames.len()];
            traffics.push(Traffic { route: *route, frames, has_come, counts: Counts::default() });
            let channel = bus.port().channel(gateway, route.from);
            channels.push(channel.map_err(|error| wrong(&error))?);
        }
        let last_ns = bus.now_ns();
        Ok(Self { gateway, routes: traffics, channels, quiet: 0, last_ns, is_over: false })
    }

    fn receive(&mut self, frames: &[ReceivedFrame], now_ns: u64) {
        self.quiet = if self.routes.iter().all(Traffic::is_complete) { self.quiet + 1 } else { 0 };
        for received in frames.iter().filter(|received| received.slave == self.gateway) {
            let on_channel = |traffic: &&mut Traffic| traffic.route.to == received.channel;
            let Some(traffic) = self.routes.iter_mut().find(on_channel) else { continue };
            match traffic.take(&received.frame) {
                true => self.last_ns = now_ns,
                false => traffic.counts.strange += 1,
            }
        }
    }

    /// Sends on the routes in turn, so that no channel fills the whole image.
    fn send(&mut self, cycle: &mut Cycle<'_>, now_ns: u64) -> Result<(), SendError> {
        let mut is_open = vec![true; self.routes.len()];
        while is_open.contains(&true) {
            let routes = self.routes.iter_mut().zip(&self.channels);
            for ((traffic, channel), is_open) in routes.zip(&mut is_open) {
                let taken = match traffic.next() {
                    Some(frame) => match cycle.send(*channel, frame) {
                        Ok(_) => true,
                        Err(error) if error.is_temporary() => false,
                        Err(error) => return Err(error),
                    },
                    None => false,
                };
                traffic.counts.sent += u32::from(taken);
                *is_open = taken;
                if taken {
                    self.last_ns = now_ns;
                }
            }
        }
        self.is_over =
            self.quiet >= QUIET_CYCLES || now_ns.saturating_sub(self.last_ns) >= STANDSTILL_NS;
        Ok(())
    }
}

/// Sends `count` frames on every route of all gateways in parallel; returns when all are received
/// and no frame follows, or without progress. The result has the routes of each gateway; `None` if
/// the user stops.
pub(super) fn exchange(
    bus: &mut TestBus,
    gateways: &[usize],
    routes: &[Route],
    count: u16,
    is_fd: bool,
) -> Result<Option<Vec<Vec<Counts>>>> {
    let start = |gateway: &usize| GatewayTraffic::new(bus, *gateway, routes, count, is_fd);
    let mut traffics = gateways.iter().map(start).collect::<Result<Vec<_>>>()?;
    while traffics.iter().any(|traffic| !traffic.is_over) {
        if bus.is_interrupted() {
            return Ok(None);
        }
        let sent = bus.cycle(|cycle| {
            let now_ns = cycle.adapter().clock().now_ns();
            let frames: Vec<_> =
                cycle.received().filter_map(|item| item.to_owned().frame().copied()).collect();
            for traffic in traffics.iter_mut().filter(|traffic| !traffic.is_over) {
                traffic.receive(&frames, now_ns);
                traffic.send(cycle, now_ns)?;
            }
            Ok(())
        })?;
        sent.map_err(|error: SendError| Failure::Usage(error.to_string()))?;
    }
    let counts = |traffic: GatewayTraffic| {
        traffic.routes.into_iter().map(|traffic| traffic.counts).collect()
    };
    Ok(Some(traffics.into_iter().map(counts).collect()))
}
