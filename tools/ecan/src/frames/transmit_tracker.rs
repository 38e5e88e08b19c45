//! Tracks the transmission of frames by transmit results and pending counts (manual 7, 10), and at the
//! end by the transmit FIFO of each controller (0x9000:06): whether the pending count includes the
//! frame that the controller is trying to send is an assumption (H22).

use std::collections::HashMap;

use ecan_protocol::config::TxMode;
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::{CHANNELS, Direction};
use ecan_tool_support::diagnosis::registers::TransmitQueueStatus;

use crate::context::{Failure, Result};
use crate::frames::bit_rates::BitRates;
use crate::frames::channels::Channels;
use crate::frames::link::{Event, Outcome, Ticket};
use crate::frames::service::{Cycle, Service};

/// Cycles after the last result until the channel status covers all frames.
const STATUS_CYCLES: usize = 3;
/// The only gateway of the command.
const GATEWAY: usize = 0;
const PENDING_FRAMES: usize = 4096;
/// Saturation value of the pending count in the status word.
const SATURATED: u32 = 7;

#[derive(Debug, Default)]
pub struct TransmitTracker {
    channels: Channels,
    /// Frames without result, with their numbers.
    open: HashMap<Ticket, u64>,
    taken: u64,
    handed_over: u64,
    failed: u64,
    first_failure: Option<(u64, Outcome)>,
    quiet_cycles: usize,
    /// Accepted frames after the last cycles, the oldest first.
    recently_handed_over: [u64; STATUS_CYCLES],
    /// Number of accepted frames that were sent for sure.
    departed: u64,
    /// Maximum number of frames in the channels.
    capacity: u64,
    /// Frames pending in the channels at the end.
    waiting: u64,
    /// Frames in the transmit FIFOs when they were last read.
    in_controllers: [u8; CHANNELS],
    /// Frames that a lost gateway may have held.
    doubtful: u64,
    pending: u32,
    is_ready: bool,
    was_lost: bool,
    is_stopped: bool,
    /// Channel that was bus-off; it may have recovered.
    bus_off: Option<u8>,
    /// Observed time of the last frame or result.
    last_progress_ns: u64,
    start_ns: u64,
    last_departure_ns: u64,
}

impl TransmitTracker {
    /// Starts tracking a ready gateway.
    pub fn new(channels: Channels, service: &Service) -> Self {
        let (now_ns, observed_ns) = (service.now_ns(), service.observed_ns());
        Self {
            channels,
            open: HashMap::with_capacity(PENDING_FRAMES),
            capacity: channels.iter().map(|channel| service.capacity(GATEWAY, channel)).sum(),
            is_ready: service.is_ready(GATEWAY),
            last_progress_ns: observed_ns,
            start_ns: now_ns,
            last_departure_ns: now_ns,
            ..Self::default()
        }
    }

    /// Adds a frame; numbers count from 0.
    pub fn taken(&mut self, ticket: Ticket, service: &Service) {
        self.open.insert(ticket, self.taken);
        self.taken += 1;
        (self.quiet_cycles, self.last_progress_ns) = (0, service.observed_ns());
    }

    pub fn look(&mut self, cycle: &Cycle, service: &Service) {
        self.watch_session(service.is_ready(GATEWAY));
        let is_off = |channel: &u8| service.channel_status(GATEWAY, *channel).bus_off();
        self.bus_off = self.bus_off.or_else(|| self.channels.iter().find(is_off));
        self.quiet_cycles = self.quiet_cycles.saturating_add(1);
        for arrival in &cycle.arrivals {
            let Event::Result { ticket, outcome } = arrival.event else { continue };
            let Some(number) = ticket.and_then(|ticket| self.open.remove(&ticket)) else {
                continue;
            };
            (self.quiet_cycles, self.last_progress_ns) = (0, service.observed_ns());
            if outcome.is_success() {
                self.handed_over += 1;
                self.last_departure_ns = cycle.now_ns;
            } else {
                self.failed += 1;
                self.first_failure.get_or_insert((number, outcome));
            }
        }
        if !self.is_ready {
            return;
        }
        let pending = pending(self.channels, service);
        if pending < self.pending {
            (self.last_progress_ns, self.last_departure_ns) = (service.observed_ns(), cycle.now_ns);
        }
        self.pending = pending;
        if pending < SATURATED {
            // Frames accepted that long ago and not pending were sent.
            let [oldest, ..] = self.recently_handed_over;
            self.departed = self.departed.max(oldest.saturating_sub(pending.into()));
        }
        self.recently_handed_over.rotate_left(1);
        let [.., newest] = &mut self.recently_handed_over;
        *newest = self.handed_over;
    }

    /// A lost gateway drops its frames.
    fn watch_session(&mut self, is_ready: bool) {
        if self.is_ready && !is_ready {
            self.was_lost = true;
            self.doubtful += self.possibly_held();
            self.departed = self.handed_over;
        }
        self.is_ready = is_ready;
    }

    fn possibly_held(&self) -> u64 {
        (self.handed_over - self.departed).min(self.capacity)
    }

    pub fn channels(&self) -> Channels {
        self.channels
    }

    /// Number of frames added.
    pub fn count(&self) -> u64 {
        self.taken
    }

    /// Time from the start to the last sent frame, in nanoseconds.
    pub fn elapsed_ns(&self) -> u64 {
        self.last_departure_ns.saturating_sub(self.start_ns)
    }

    /// Number and result of the first rejected frame.
    pub fn first_failure(&self) -> Option<(u64, Outcome)> {
        self.first_failure
    }

    /// Observed time since the last frame or result, in nanoseconds.
    pub fn stall_ns(&self, service: &Service) -> u64 {
        service.observed_ns().saturating_sub(self.last_progress_ns)
    }

    /// Returns whether every frame has its result and no channel holds frames.
    pub fn are_settled(&self, service: &Service) -> bool {
        self.open.is_empty()
            && self.quiet_cycles >= STATUS_CYCLES
            && pending(self.channels, service) == 0
    }

    /// Reads the transmit FIFOs. Returns whether they are empty; those that cannot be read, or that
    /// are no FIFO, count as empty.
    pub fn controllers_are_empty(&mut self, service: &mut Service) -> bool {
        for channel in self.channels.iter() {
            let Some(can) = service.can(GATEWAY, channel) else { continue };
            let (mode, size) = (can.ram.tx_mode, can.ram.tx_fifo_size);
            let held = match service.upload(GATEWAY, 0x9000 + u16::from(channel), 6) {
                Ok(raw) if mode == TxMode::Fifo => {
                    size.saturating_sub(TransmitQueueStatus::from_raw(raw).free)
                }
                _ => 0,
            };
            if let Some(entry) = self.in_controllers.get_mut(usize::from(channel)) {
                *entry = held;
            }
        }
        self.in_controllers == [0; CHANNELS]
    }

    /// Ends tracking: counts the pending frames, with a mailbox access if the gateway responds.
    pub fn close(&mut self, service: &mut Service, has_answers: bool) {
        self.is_stopped = service.is_interrupted();
        if !has_answers || !self.is_ready {
            self.doubtful += self.possibly_held();
            return;
        }
        if self.pending < SATURATED {
            let in_controllers: u64 = self.in_controllers.iter().map(|held| u64::from(*held)).sum();
            self.waiting = in_controllers.max(self.pending.into());
            return;
        }
        // The status word saturates; read the count (0x9000:11).
        let mut count = |channel: u8| service.upload(GATEWAY, 0x9000 + u16::from(channel), 11);
        match self.channels.iter().map(&mut count).sum::<Result<u32, _>>() {
            Ok(count) => self.waiting = count.into(),
            Err(_) => self.doubtful += self.possibly_held(),
        }
    }

    /// Final counts, after [`close`](Self::close). Frames pending in a channel are not sent.
    pub fn outcome(&self) -> TransmitCounts {
        let doubtful = self.doubtful.min(self.handed_over);
        let waiting = self.waiting.min(self.handed_over - doubtful);
        let (held, open) = (waiting, self.open.len() as u64);
        let is_under_way = self.is_stopped && !self.was_lost;
        TransmitCounts {
            sent: self.handed_over - waiting - doubtful,
            rejected: self.failed,
            waiting: if is_under_way { 0 } else { held },
            unknown: doubtful + if is_under_way { 0 } else { open },
            under_way: if is_under_way { held + open } else { 0 },
            bus_off: self.bus_off,
        }
    }

    pub fn failure(&self, service: &Service, message: String, otherwise: Option<&str>) -> Failure {
        if self.was_lost {
            return service.not_ready(GATEWAY, &message);
        }
        match self.cause(service).or(otherwise.map(str::to_owned)) {
            Some(cause) => Failure::Incomplete(format!("{message}: {cause}")),
            None => Failure::Incomplete(message),
        }
    }

    fn cause(&self, service: &Service) -> Option<String> {
        let rates = |channel| {
            let can = service.can(GATEWAY, channel);
            can.map_or_else(String::new, |can| BitRates::of(can).to_string())
        };
        if let Some(channel) = self.bus_off {
            let rates = rates(channel);
            return Some(format!(
                "channel {channel} went bus-off; check that the other nodes use {rates}, and the wiring"
            ));
        }
        if self.handed_over + self.failed == 0 && !self.open.is_empty() {
            let only_sends = |channel: &u8| !service.carries(GATEWAY, Direction::TxPdo, *channel);
            if let Some(channel) = self.channels.iter().find(only_sends) {
                return Some(format!(
                    "channel {channel} only sends, and the gateway may report no transmit result of \
                     it (assumption H45); check at another node whether the frames arrive"
                ));
            }
            return Some(
                "no transmit result arrived; the gateway may report failures only (assumption H17); \
                 check at another node whether the frames arrive"
                    .to_owned(),
            );
        }
        let holds_frames = |channel: &u8| {
            service.channel_status(GATEWAY, *channel).tx_pending() > 0
                || self.in_controllers.get(usize::from(*channel)).is_some_and(|held| *held > 0)
        };
        let channel = self.channels.iter().find(holds_frames)?;
        let status: ChannelStatus = service.channel_status(GATEWAY, channel);
        let rates = rates(channel);
        Some(if status.warn() {
            format!(
                "channel {channel} gets no acknowledgement; check for another node with {rates} \
                 and the same sample points, wiring and termination"
            )
        } else {
            format!("channel {channel} has pending frames; check the bus load")
        })
    }
}

/// Pending frames in the channels, from their status, up to 7 each.
fn pending(channels: Channels, service: &Service) -> u32 {
    channels.iter().map(|it| u32::from(service.channel_status(GATEWAY, it).tx_pending())).sum()
}

#[derive(Clone, Copy, Debug)]
pub struct TransmitCounts {
    pub sent: u64,
    pub rejected: u64,
    /// Frames pending in a channel.
    pub waiting: u64,
    /// Frames without result, or in a gateway that was lost.
    pub unknown: u64,
    /// Frames in transit when the user stopped.
    pub under_way: u64,
    /// Channel that was bus-off: its frames may be lost.
    pub bus_off: Option<u8>,
}

impl TransmitCounts {
    /// Frames not confirmed as sent.
    pub fn lost(&self) -> u64 {
        self.rejected + self.waiting + self.unknown
    }
}
