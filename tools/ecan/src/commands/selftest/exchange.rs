//! Sends the frames of a test, compares the received frames, and judges the counts of a route. The CAN ID of a
//! frame contains its sender and its number.

use std::collections::BTreeMap;
use std::fmt::Display;

use ecan_host::{Diagnostics, Error};
use ecan_mcan_port::ChannelHandle;
use ecan_protocol::can::{CanFrame, CanId, FrameError, FrameKind};
use ecan_tool_support::diagnosis::registers::{ErrorCounters, LastErrorCode, ProtocolStatus};
use serde::Serialize;

use super::plan::{Route, TestPath};
use super::test_bus::TestBus;
use crate::context::{Failure, Result};

/// Time without progress that ends a test, in ns; a frame of 64 bytes takes 6 ms at 125 kbit/s.
const STANDSTILL_NS: u64 = 500_000_000;
/// Cycles to wait for further frames after the last one.
const QUIET_CYCLES: u64 = 20;

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
    pub(super) fn read(bus: &Diagnostics, slave: usize, channel: u8) -> Result<Self, Error> {
        let get = |subindex| bus.sdo_upload_u32(slave, 0x9000 + u16::from(channel), subindex);
        Ok(Self { dropped: get(13)?, bus_off_count: get(15)? })
    }
}

impl ChannelState {
    pub(super) fn read(bus: &Diagnostics, slave: usize, channel: u8) -> Result<Self, Error> {
        let get = |subindex| bus.sdo_upload_u32(slave, 0x9000 + u16::from(channel), subindex);
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

    /// Handles a frame received on the route's channel. Returns whether it is the first one with its
    /// number: progress.
    fn take(&mut self, came: &CanFrame) -> bool {
        let number = origin(came).filter(|(from, _)| *from == self.route.from);
        let number = number.map(|(_, number)| usize::from(number));
        let is_sent = |number: &usize| *number < self.counts.sent as usize;
        let slot = number
            .filter(is_sent)
            .and_then(|number| Some((self.frames.get(number)?, self.has_come.get_mut(number)?)));
        let Some((sent, has_come)) = slot else {
            self.counts.strange += 1;
            return false;
        };
        let is_repeated = std::mem::replace(has_come, true);
        match difference(sent, came) {
            Some(message) => {
                self.counts.wrong += 1;
                self.counts.first_wrong.get_or_insert(message);
            }
            None if is_repeated => self.counts.repeated += 1,
            None => self.counts.received += 1,
        }
        !is_repeated
    }
}

/// A received frame: gateway, channel, frame.
pub(super) type Received = (usize, u8, CanFrame);

/// Traffic of one gateway.
pub(super) struct GatewayTraffic {
    gateway: usize,
    routes: Vec<Traffic>,
    /// Time of the last progress.
    last_ns: u64,
    is_over: bool,
    waits: Waits,
}

/// Times without a frame that end an exchange, in ns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Waits {
    /// After the last expected frame.
    pub(super) quiet_ns: u64,
    /// While frames are missing.
    pub(super) standstill_ns: u64,
}

impl GatewayTraffic {
    pub(super) fn new(
        gateway: usize,
        routes: &[Route],
        count: u16,
        is_fd: bool,
        now_ns: u64,
        waits: Waits,
    ) -> Result<Self> {
        let mut traffics = Vec::new();
        for route in routes {
            let frames = (0..count).map(|number| frame(route.from, number, is_fd));
            let frames = frames.collect::<Result<Vec<_>, _>>().map_err(usage)?;
            let has_come = vec![false; frames.len()];
            traffics.push(Traffic { route: *route, frames, has_come, counts: Counts::default() });
        }
        Ok(Self { gateway, routes: traffics, last_ns: now_ns, is_over: false, waits })
    }

    pub(super) fn is_over(&self) -> bool {
        self.is_over
    }

    /// Counts of the routes.
    pub(super) fn into_counts(self) -> Vec<Counts> {
        self.routes.into_iter().map(|traffic| traffic.counts).collect()
    }

    /// Handles the received frames, then sends on the routes in turn, so that no channel fills the
    /// whole image. `send` returns false without space.
    pub(super) fn step(
        &mut self,
        received: &[Received],
        now_ns: u64,
        mut send: impl FnMut(usize, u8, &CanFrame) -> Result<bool>,
    ) -> Result {
        for (_, channel, frame) in received.iter().filter(|arrival| arrival.0 == self.gateway) {
            let on_channel = |traffic: &&mut Traffic| traffic.route.to == *channel;
            let Some(traffic) = self.routes.iter_mut().find(on_channel) else { continue };
            if traffic.take(frame) {
                self.last_ns = now_ns;
            }
        }
        let mut is_open = vec![true; self.routes.len()];
        while is_open.contains(&true) {
            for (traffic, is_open) in self.routes.iter_mut().zip(&mut is_open) {
                let is_sent = match traffic.next() {
                    Some(frame) => send(self.gateway, traffic.route.from, frame)?,
                    None => false,
                };
                traffic.counts.sent += u32::from(is_sent);
                *is_open = is_sent;
                if is_sent {
                    self.last_ns = now_ns;
                }
            }
        }
        let Waits { quiet_ns, standstill_ns } = self.waits;
        let is_complete = self.routes.iter().all(Traffic::is_complete);
        let wait_ns = if is_complete { quiet_ns } else { standstill_ns };
        self.is_over = now_ns.saturating_sub(self.last_ns) >= wait_ns;
        Ok(())
    }
}

fn usage(error: impl Display) -> Failure {
    Failure::Usage(error.to_string())
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
    let cycle_ns = u64::from(bus.port().adapter().config().cycle_ns());
    let waits = Waits { quiet_ns: QUIET_CYCLES * cycle_ns, standstill_ns: STANDSTILL_NS };
    let now_ns = bus.now_ns();
    let start =
        |gateway: &usize| GatewayTraffic::new(*gateway, routes, count, is_fd, now_ns, waits);
    let mut traffics = gateways.iter().map(start).collect::<Result<Vec<_>>>()?;
    let mut handles = BTreeMap::<(usize, u8), ChannelHandle>::new();
    for (gateway, route) in
        gateways.iter().flat_map(|gateway| routes.iter().map(move |at| (gateway, at)))
    {
        let handle = bus.port().channel(*gateway, route.from).map_err(usage)?;
        handles.insert((*gateway, route.from), handle);
    }
    while traffics.iter().any(|traffic| !traffic.is_over) {
        if bus.is_interrupted() {
            return Ok(None);
        }
        bus.cycle(|cycle| {
            let now_ns = cycle.adapter().clock().now_ns();
            let frames = cycle.received().filter_map(|item| item.to_owned().frame().copied());
            let received: Vec<_> =
                frames.map(|frame| (frame.slave, frame.channel, frame.frame)).collect();
            let mut send = |gateway, channel, frame: &CanFrame| {
                let Some(handle) = handles.get(&(gateway, channel)) else { return Ok(false) };
                match cycle.send(*handle, frame) {
                    Ok(_) => Ok(true),
                    Err(error) if error.is_temporary() => Ok(false),
                    Err(error) => Err(usage(error)),
                }
            };
            let open = traffics.iter_mut().filter(|traffic| !traffic.is_over);
            open.into_iter().try_for_each(|traffic| traffic.step(&received, now_ns, &mut send))
        })??;
    }
    Ok(Some(traffics.into_iter().map(GatewayTraffic::into_counts).collect()))
}

const EXTENDED: u32 = 0x1555_0000;
const CLASSIC_LENGTHS: [usize; 9] = [8, 0, 1, 2, 3, 4, 5, 6, 7];
const FD_LENGTHS: [usize; 16] = [64, 0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48];

/// Frame `number` of a channel: all lengths, both kinds of CAN IDs and, with CAN FD, classic and
/// CAN FD frames with and without bit rate switch.
pub(super) fn frame(channel: u8, number: u16, is_fd: bool) -> Result<CanFrame, FrameError> {
    let raw = u16::from(channel) << 8 | number & 0xFF;
    let id = match number % 2 {
        0 => CanId::standard(raw),
        _ => CanId::extended(EXTENDED | u32::from(raw)),
    };
    let kind = if is_fd { number / 2 % 3 } else { 0 };
    let step = usize::from(if is_fd { number / 6 } else { number / 2 });
    let lengths = if kind == 0 { &CLASSIC_LENGTHS[..] } else { &FD_LENGTHS[..] };
    let length = lengths.get(step % lengths.len()).copied().unwrap_or_default();
    let mut data = [0; 64];
    let bytes = data.get_mut(..length).unwrap_or_default();
    for (at, byte) in bytes.iter_mut().enumerate() {
        *byte = pattern(channel, number, at);
    }
    match kind {
        0 => CanFrame::classic(id?, bytes),
        kind => CanFrame::fd(id?, bytes, kind == 1, false),
    }
}

/// The data alternate between bit patterns that stress stuffing and transceivers, and patterns that
/// make each byte of each frame unique.
fn pattern(channel: u8, number: u16, at: usize) -> u8 {
    match number / 2 % 5 {
        0 => 0x00,
        1 => 0xFF,
        2 => [0x55, 0xAA][at % 2],
        _ => {
            let seed = u32::from(channel) << 16 | u32::from(number) << 8 | at as u32 & 0xFF;
            (seed.wrapping_mul(0x9E37_79B1) >> 24) as u8
        }
    }
}

/// Sender and number of a frame; `None` for a frame that is not from a test.
pub(super) fn origin(frame: &CanFrame) -> Option<(u8, u16)> {
    let (id, is_extended) = (frame.id().raw(), frame.id().is_extended());
    let raw = if is_extended { id.checked_sub(EXTENDED)? } else { id };
    let channel = u8::try_from(raw >> 8)
        .ok()
        .filter(|channel| usize::from(*channel) < ecan_protocol::mapping::CHANNELS);
    let number = (raw & 0xFF) as u16;
    let is_kind = is_extended == (number % 2 == 1);
    channel.filter(|_| is_kind).map(|channel| (channel, number))
}

/// Returns the difference between a sent and a received frame. Ignores the ESI bit, because the
/// error counters show error states.
pub(super) fn difference(sent: &CanFrame, came: &CanFrame) -> Option<String> {
    let kind = |frame: &CanFrame| match frame.kind() {
        FrameKind::Data => "a classic frame",
        FrameKind::Remote => "a remote frame",
        FrameKind::Fd { brs: true, .. } => "a CAN FD frame with bit rate switch",
        FrameKind::Fd { brs: false, .. } => "a CAN FD frame without bit rate switch",
    };
    if kind(sent) != kind(came) {
        return Some(format!("sent {}, received {}", kind(sent), kind(came)));
    }
    let (sent, came) = (sent.data(), came.data());
    if sent.len() != came.len() {
        return Some(format!("sent {} bytes, received {}", sent.len(), came.len()));
    }
    let (at, (sent, came)) = sent.iter().zip(came).enumerate().find(|(_, (a, b))| a != b)?;
    Some(format!("byte {at}: sent 0x{sent:02X}, received 0x{came:02X}"))
}

/// Result of a route; `states` are those of its channels before and after.
pub(super) fn check_counts(
    path: TestPath,
    route: Route,
    counts: &Counts,
    expected: u16,
    states: &[&(ChannelCounters, ChannelState)],
) -> Result<String, String> {
    let mut faults = Vec::new();
    let came = counts.received + counts.wrong;
    if came < u32::from(expected) {
        let why = missing(path, route, states).map_or_else(String::new, |why| format!(" ({why})"));
        faults.push(format!("{came} of {expected} frames received{why}"));
    }
    if let Some(first) = &counts.first_wrong {
        faults.push(format!("{} frames received with errors, the first: {first}", counts.wrong));
    }
    if counts.repeated > 0 {
        faults.push(format!("{} frames received twice", counts.repeated));
    }
    if counts.strange > 0 {
        let (to, strange) = (route.to, counts.strange);
        let detail = "from another sender; check for other nodes on its bus";
        faults.push(format!("channel {to} received {strange} frames {detail}"));
    }
    faults.extend(states.iter().flat_map(|(before, after)| after.faults(before)));
    match faults.is_empty() {
        true if came == 1 => Ok("1 frame, no errors".to_owned()),
        true => Ok(format!("{came} frames, no errors")),
        false => Err(faults.join("; ")),
    }
}

fn missing(
    path: TestPath,
    Route { from, to }: Route,
    states: &[&(ChannelCounters, ChannelState)],
) -> Option<String> {
    let (_, sender) = states.iter().find(|(_, state)| state.channel == from)?;
    (path == TestPath::Wire && sender.is_unheard()).then(|| {
        format!("no acknowledgement; check the wiring from channel {from} to channel {to} and its termination")
    })
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::super::plan::MOST_FRAMES;
    use super::*;

    #[test]
    fn frames_cover_every_kind_and_identify_the_sender() {
        let mut kinds = HashSet::new();
        for (channel, number) in
            (0..4).flat_map(|channel| (0..MOST_FRAMES).map(move |number| (channel, number)))
        {
            let classic = frame(channel, number, false).unwrap();
            assert_eq!(origin(&classic), Some((channel, number)));
            assert!(!classic.is_fd());
            let fd = frame(channel, number, true).unwrap();
            assert_eq!(origin(&fd), Some((channel, number)));
            kinds.insert((fd.kind(), fd.data().len(), fd.id().is_extended()));
        }
        // Two kinds of CAN IDs; 9 lengths of classic frames, 16 of each kind of CAN FD.
        assert_eq!(kinds.len(), 2 * (9 + 16 + 16));
    }

    #[test]
    fn differences_are_described() {
        let id = CanId::standard(0x100).unwrap();
        let one = CanFrame::classic(id, &[1, 2]).unwrap();
        let says = |other: CanFrame| difference(&one, &other);
        assert_eq!(says(one), None);
        let message = "byte 1: sent 0x02, received 0x06";
        assert_eq!(says(CanFrame::classic(id, &[1, 6]).unwrap()).as_deref(), Some(message));
        let message = "sent 2 bytes, received 1";
        assert_eq!(says(CanFrame::classic(id, &[1]).unwrap()).as_deref(), Some(message));
        let message = "sent a classic frame, received a CAN FD frame without bit rate switch";
        assert_eq!(
            says(CanFrame::fd(id, &[1, 2], false, false).unwrap()).as_deref(),
            Some(message)
        );
    }
}
