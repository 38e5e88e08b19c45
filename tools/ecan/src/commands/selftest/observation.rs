//! Traffic on the buses before a test: a loopback takes the channel off its bus, and each new
//! configuration loses frames.

use std::collections::BTreeMap;

use ecan_protocol::can::CanId;
use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;
use ecan_tool_support::diagnosis::registers::{
    ErrorCounters, LastErrorCode, ProtocolStatus, ReceiveFifoStatus,
};

use super::exchange;
use crate::context::{Bus, Failure, Result};

/// Traffic on the bus of a channel.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Traffic {
    pub(super) position: usize,
    pub(super) channel: u8,
    /// Frames or errors, as text.
    pub(super) seen: String,
}

/// Ends the test if there is traffic.
pub(super) fn require_no_traffic(traffic: &[Traffic], observe_ms: u32) -> Result {
    if traffic.is_empty() {
        return Ok(());
    }
    let channels: Vec<_> = traffic
        .iter()
        .map(|traffic| {
            format!("channel {} of slave {}: {}", traffic.channel, traffic.position, traffic.seen)
        })
        .collect();
    Err(Failure::Rejected(format!(
        "traffic on the bus within {observe_ms} ms: {}; the test would disturb it: disconnect the bus or stop \
         its nodes, or test nevertheless with --force",
        channels.join("; ")
    )))
}

/// Values of an active channel that change with frames on its bus (0x9000, manual 13.5).
#[derive(Clone, Copy, Debug)]
struct ActiveChannel {
    status: ProtocolStatus,
    counters: ErrorCounters,
    fifos: [ReceiveFifoStatus; 2],
    interrupts: u32,
    pending: u32,
    dropped: u32,
}

impl ActiveChannel {
    fn read(bus: &Bus, slave: usize, channel: u8) -> Result<Self> {
        let get = |subindex| bus.read(slave, 0x9000 + u16::from(channel), subindex);
        Ok(Self {
            counters: ErrorCounters::from_raw(get(1)?),
            status: ProtocolStatus::from_raw(get(2)?),
            interrupts: get(3)?,
            fifos: [ReceiveFifoStatus::from_raw(get(4)?), ReceiveFifoStatus::from_raw(get(5)?)],
            pending: get(10)?,
            dropped: get(13)?,
        })
    }

    fn traffic(&self, before: &Self) -> Option<String> {
        if self.status.last_error.is_error() || self.counters.logged > 0 {
            return Some(error_text(&self.status, &self.counters));
        }
        let received = self.fifos != before.fifos
            || self.interrupts != before.interrupts
            || (self.pending, self.dropped) != (before.pending, before.dropped)
            // The first read has cleared the code: a frame has passed since.
            || self.status.last_error == LastErrorCode::None
                && before.status.last_error != LastErrorCode::None;
        if received {
            return Some("it is active and has received frames".to_owned());
        }
        let is_full = |fifo: &ReceiveFifoStatus| fifo.is_full || fifo.has_lost;
        self.fifos
            .iter()
            .position(is_full)
            .map(|number| format!("it is active, and RX FIFO{number} is full of frames"))
    }
}

fn error_text(status: &ProtocolStatus, counters: &ErrorCounters) -> String {
    let last = match status.last_error.is_error() {
        true => format!(", the last one a {}", status.last_error),
        false => String::new(),
    };
    format!("bus errors ({counters}{last}), as of traffic with another bit rate")
}

/// Observes the channels that are active, without changing anything. A slave whose values cannot be
/// read is left to the test.
pub(super) fn of_active_channels(
    bus: &Bus,
    slaves: &[usize],
    tested: [bool; CHANNELS],
    observe_ms: u32,
) -> Vec<Traffic> {
    let read = |bus: &Bus, slave: usize| -> Result<BTreeMap<u8, ActiveChannel>> {
        let mut active = BTreeMap::new();
        for channel in (0..).zip(tested).filter(|numbered| numbered.1).map(|numbered| numbered.0) {
            let raw = bus.read(slave, 0x9000 + u16::from(channel), 9)?;
            let status = ChannelStatus::from_raw(raw as u16);
            let is_off = matches!(status.state(), ChannelState::Disabled | ChannelState::Init);
            if !is_off || status.bus_off() {
                active.insert(channel, ActiveChannel::read(bus, slave, channel)?);
            }
        }
        Ok(active)
    };
    let before = bus.in_parallel(slaves, read);
    if before.iter().flatten().all(BTreeMap::is_empty) {
        return Vec::new();
    }
    bus.sleep_ns(u64::from(observe_ms) * 1_000_000);
    let mut traffic = Vec::new();
    for ((slave, before), after) in slaves.iter().zip(before).zip(bus.in_parallel(slaves, read)) {
        let (Ok(before), Ok(after)) = (before, after) else { continue };
        for (channel, after) in after {
            if let Some(seen) = before.get(&channel).and_then(|before| after.traffic(before)) {
                traffic.push(Traffic { position: *slave, channel, seen });
            }
        }
    }
    traffic
}

/// Frames that a channel received while it only listened.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FramesReceived {
    count: u64,
    first: Option<CanId>,
}

impl FramesReceived {
    pub(super) fn add(&mut self, id: CanId) {
        self.count += 1;
        self.first.get_or_insert(id);
    }

    /// Traffic by the received frames, or by the errors that the channel has seen.
    pub(super) fn traffic(&self, state: &exchange::ChannelState) -> Option<String> {
        if let Some(first) = self.first {
            return Some(format!("{} frames, the first with CAN ID 0x{first}", self.count));
        }
        let ErrorCounters { receive, is_receive_passive, logged, .. } = state.counters;
        let has_errors = receive > 0 || is_receive_passive || logged > 0;
        (has_errors || state.status.last_error.is_error())
            .then(|| error_text(&state.status, &state.counters))
    }
}
