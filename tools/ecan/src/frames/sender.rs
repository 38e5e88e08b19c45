//! Transmission of frames with its summary. Tracks them by transmit results and pending counts (manual 7, 10), and
//! at the end by the transmit FIFO of each controller (0x9000:06): whether the pending count includes the
//! frame that the controller is trying to send is an assumption (H22).

use std::collections::HashMap;

use ecan_protocol::can::CanFrame;
use ecan_protocol::config::TxMode;
use ecan_protocol::image::{ChannelStatus, Timestamp};
use ecan_protocol::mapping::{CHANNELS, Direction};
use ecan_tool_support::diagnosis::registers::TransmitQueueStatus;
use serde::Serialize;

use super::channels::{BitRates, Channels};
use super::link::{BusFrame, Event, Outcome, Ticket};
use super::printer::{Printer, TimedFrame};
use super::service::{Cycle, Service};
use crate::context::{Failure, Output, Result};

/// Time for pending frames after the user stops, in cycle time, so that pauses of the computer do
/// not count.
const GRACE_NS: u64 = 100_000_000;

#[derive(Clone, Copy, Debug)]
pub struct Due {
    /// Due time after the start, in nanoseconds.
    pub after_ns: u64,
    pub channel: u8,
    pub frame: CanFrame,
}

#[derive(Debug)]
pub enum Record {
    Nothing,
    Sent(Printer),
    Received(Printer),
}

impl Record {
    fn printer(&mut self) -> Option<&mut Printer> {
        match self {
            Self::Nothing => None,
            Self::Sent(printer) | Self::Received(printer) => Some(printer),
        }
    }

    fn is_over(&mut self) -> bool {
        self.printer().is_some_and(|printer| printer.is_over())
    }

    fn print_sent(&mut self, due: Due, service: &Service) {
        if let Self::Sent(printer) = self {
            let Due { channel, frame, .. } = due;
            let frame =
                BusFrame { gateway: 0, channel, frame, timestamp: Timestamp::None, is_sent: true };
            // Sent frames are printed without time stamps.
            let timed = TimedFrame { time_ns: 0, frame, gap: None };
            printer.put(timed, service.is_real_time());
        }
    }

    fn print_received(&mut self, cycle: &Cycle, service: &mut Service) {
        let Self::Received(printer) = self else { return };
        for arrival in &cycle.arrivals {
            if let Event::Frame(frame) = arrival.event
                && !frame.is_sent
            {
                let time_ns = service.absolute_ns(arrival.time_ns);
                let gap = service.take_gap(frame.gateway);
                printer.put(TimedFrame { time_ns, frame, gap }, service.is_real_time());
            }
        }
    }

    pub fn finish(self) -> Result {
        match self {
            Self::Nothing => Ok(()),
            Self::Sent(printer) | Self::Received(printer) => printer.finish(),
        }
    }
}

#[derive(Debug)]
pub struct Sender {
    /// Observed channels.
    pub channels: Channels,
    /// Time limit without progress, in nanoseconds of observed time.
    pub timeout_ns: u64,
    pub record: Record,
}

impl Sender {
    /// Sends all frames (`total`, if finite), prints the summary and checks it.
    pub fn run(
        mut self,
        mut service: Service,
        frames: impl Iterator<Item = Result<Due>>,
        total: Option<u64>,
        output: &Output,
    ) -> Result {
        let (tracker, outcome) = self.send(&mut service, frames);
        let recorded = self.record.finish();
        let captured = service.finish();
        let expected = total.filter(|_| !service.is_interrupted()).unwrap_or(tracker.count());
        let summary = Summary::of(&tracker, &service, expected);
        let printed = match recorded {
            Err(Failure::Output(_) | Failure::ReaderGone) => Ok(()),
            _ => summary.print(output),
        };
        outcome.and(recorded).and(captured).and(printed)?;
        summary.check(|message| tracker.failure(&service, message, None))
    }

    /// Sends all frames and waits for their transmission; returns the tracker also on errors.
    pub fn send(
        &mut self,
        service: &mut Service,
        frames: impl Iterator<Item = Result<Due>>,
    ) -> (TransmitTracker, Result) {
        let mut tracker = TransmitTracker::new(self.channels, service);
        let outcome = self
            .hand_over(service, frames, &mut tracker)
            .and_then(|()| self.settle(service, &mut tracker));
        tracker.close(service, outcome.is_ok());
        (tracker, outcome)
    }

    fn hand_over(
        &mut self,
        service: &mut Service,
        mut frames: impl Iterator<Item = Result<Due>>,
        tracker: &mut TransmitTracker,
    ) -> Result {
        let start_ns = service.now_ns();
        let mut next = frames.next().transpose()?;
        while next.is_some() && !service.is_interrupted() && !self.record.is_over() {
            let cycle = service.begin();
            tracker.look(&cycle, service);
            self.record.print_received(&cycle, service);
            let mut has_space = true;
            while let Some(due) = next.filter(|due| due.after_ns <= cycle.now_ns - start_ns)
                && has_space
            {
                match service.send(0, due.channel, &due.frame)? {
                    Some(ticket) => {
                        tracker.add(ticket, service);
                        self.record.print_sent(due, service);
                        next = frames.next().transpose()?;
                    }
                    // The frame and all after it wait for the next cycle, in order.
                    None => has_space = false,
                }
            }
            // A gap between due times is not a stall.
            let is_stuck = !has_space && tracker.stall_ns(service) >= self.timeout_ns;
            service.end(cycle)?;
            if is_stuck {
                break;
            }
        }
        Ok(())
    }

    /// Runs the cycle until all frames are sent or there is no progress; after a stop by the user,
    /// only for the pending frames.
    fn settle(&mut self, service: &mut Service, tracker: &mut TransmitTracker) -> Result {
        let cycle_ns = service.cycle_ns();
        let mut grace_ns = 0;
        while !tracker.are_settled(service) || !tracker.controllers_are_empty(service) {
            let cycle = service.begin();
            tracker.look(&cycle, service);
            self.record.print_received(&cycle, service);
            service.end(cycle)?;
            if service.is_interrupted() {
                grace_ns += cycle_ns;
                if grace_ns > GRACE_NS {
                    break;
                }
            }
            if tracker.stall_ns(service) >= self.timeout_ns {
                break;
            }
        }
        Ok(())
    }
}

#[derive(Debug, Serialize)]
pub struct Summary {
    /// Frames accepted by the gateway or waiting.
    frames: u64,
    sent: u64,
    /// Frames not confirmed as sent.
    lost: u64,
    /// Frames in transit when the user stopped.
    under_way: u64,
    /// Frames of the command that were not passed to the gateway.
    not_tried: u64,
    received: u64,
    /// Images of the gateway that were lost. The number of frames in them cannot be known.
    images_lost: u64,
    /// Most images that can have been lost in outages.
    images_unknown: u64,
    /// Time from the start to the last sent frame.
    seconds: f64,
    frames_per_second: f64,
}

impl Summary {
    pub fn of(tracker: &TransmitTracker, service: &Service, expected: u64) -> Self {
        let outcome = tracker.outcome();
        let counters = service.statistics(0);
        let of = |channel: u8| counters.channels.get(usize::from(channel));
        let channels = tracker.channels().iter().filter_map(of);
        let received = channels.map(|channel| channel.frames_received).sum();
        let seconds = tracker.elapsed_ns() as f64 / 1e9;
        Self {
            frames: tracker.count(),
            sent: outcome.sent,
            lost: outcome.lost_frames(),
            under_way: outcome.under_way,
            not_tried: expected.saturating_sub(tracker.count()),
            received,
            images_lost: counters.txpdo_lost,
            images_unknown: counters.txpdo_unknown,
            seconds,
            frames_per_second: if seconds > 0.0 { outcome.sent as f64 / seconds } else { 0.0 },
        }
    }

    pub fn print(&self, output: &Output) -> Result {
        output.data(self, |out| {
            let Self { sent, lost, under_way, received, seconds, frames_per_second, .. } = self;
            write!(out, "{sent} frames sent, {lost} lost, ")?;
            if *under_way > 0 {
                write!(out, "{under_way} in transit, ")?;
            }
            write!(out, "{received} received")?;
            writeln!(out, " in {seconds:.3} s: {frames_per_second:.1} frames/s")?;
            match (self.images_lost, self.images_unknown) {
                (0, 0) => Ok(()),
                (lost, 0) => writeln!(out, "{lost} images lost, received frames may be missing"),
                (lost, unknown) => writeln!(
                    out,
                    "{lost} images lost and up to {unknown} unknown, received frames may be missing"
                ),
            }
        })
    }

    pub fn check(&self, failure: impl FnOnce(String) -> Failure) -> Result {
        let behind = self.lost + self.not_tried;
        if behind == 0 {
            return Ok(());
        }
        let all = self.frames + self.not_tried;
        Err(failure(format!("{behind} of {all} frames not confirmed as sent")))
    }
}

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
    departures: Departures,
    failed: u64,
    first_failure: Option<(u64, Outcome)>,
    quiet_cycles: usize,
    /// Frames pending in the channels at the end.
    waiting: u64,
    /// Frames in the transmit FIFOs when they were last read.
    in_controllers: [u8; CHANNELS],
    /// Frames that a lost gateway may have held.
    doubtful: u64,
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

/// Frames that the gateway accepted, and how many of them left its channels for sure.
#[derive(Debug, Default)]
struct Departures {
    accepted: u64,
    /// Accepted frames after the last cycles, the oldest first.
    recently_accepted: [u64; STATUS_CYCLES],
    departed: u64,
    /// Maximum number of frames in the channels.
    capacity: u64,
    /// Pending frames of the last status, up to 7 of each channel.
    pending: u32,
}

impl Departures {
    /// Takes the pending frames of a status. Returns whether they are fewer than those of the last status.
    fn observe(&mut self, pending: u32) -> bool {
        let is_less = pending < self.pending;
        self.pending = pending;
        if pending < SATURATED {
            // Frames accepted that long ago and not pending were sent.
            let [oldest, ..] = self.recently_accepted;
            self.departed = self.departed.max(oldest.saturating_sub(pending.into()));
        }
        self.recently_accepted.rotate_left(1);
        let [.., newest] = &mut self.recently_accepted;
        *newest = self.accepted;
        is_less
    }

    fn count_possibly_held(&self) -> u64 {
        (self.accepted - self.departed).min(self.capacity)
    }

    /// Drops the frames in the channels, as a lost gateway does. Returns how many it may have held.
    fn drop_held(&mut self) -> u64 {
        let held = self.count_possibly_held();
        self.departed = self.accepted;
        held
    }
}

impl TransmitTracker {
    /// Starts tracking a ready gateway.
    pub fn new(channels: Channels, service: &Service) -> Self {
        let (now_ns, observed_ns) = (service.now_ns(), service.observed_ns());
        Self {
            channels,
            open: HashMap::with_capacity(PENDING_FRAMES),
            departures: Departures {
                capacity: channels.iter().map(|channel| service.capacity(GATEWAY, channel)).sum(),
                ..Departures::default()
            },
            is_ready: service.is_ready(GATEWAY),
            last_progress_ns: observed_ns,
            start_ns: now_ns,
            last_departure_ns: now_ns,
            ..Self::default()
        }
    }

    /// Adds a frame; numbers count from 0.
    pub fn add(&mut self, ticket: Ticket, service: &Service) {
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
                self.departures.accepted += 1;
                self.last_departure_ns = cycle.now_ns;
            } else {
                self.failed += 1;
                self.first_failure.get_or_insert((number, outcome));
            }
        }
        if !self.is_ready {
            return;
        }
        if self.departures.observe(pending(self.channels, service)) {
            (self.last_progress_ns, self.last_departure_ns) = (service.observed_ns(), cycle.now_ns);
        }
    }

    /// A lost gateway drops its frames.
    fn watch_session(&mut self, is_ready: bool) {
        if self.is_ready && !is_ready {
            self.was_lost = true;
            self.doubtful += self.departures.drop_held();
        }
        self.is_ready = is_ready;
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
            self.doubtful += self.departures.count_possibly_held();
            return;
        }
        if self.departures.pending < SATURATED {
            let in_controllers: u64 = self.in_controllers.iter().map(|held| u64::from(*held)).sum();
            self.waiting = in_controllers.max(self.departures.pending.into());
            return;
        }
        // The status word saturates; read the count (0x9000:11).
        let mut count = |channel: u8| service.upload(GATEWAY, 0x9000 + u16::from(channel), 11);
        match self.channels.iter().map(&mut count).sum::<Result<u32, _>>() {
            Ok(count) => self.waiting = count.into(),
            Err(_) => self.doubtful += self.departures.count_possibly_held(),
        }
    }

    /// Final counts, after [`close`](Self::close). Frames pending in a channel are not sent.
    pub fn outcome(&self) -> TransmitCounts {
        let accepted = self.departures.accepted;
        let doubtful = self.doubtful.min(accepted);
        let waiting = self.waiting.min(accepted - doubtful);
        let (held, open) = (waiting, self.open.len() as u64);
        let is_under_way = self.is_stopped && !self.was_lost;
        TransmitCounts {
            sent: accepted - waiting - doubtful,
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
        if self.departures.accepted + self.failed == 0 && !self.open.is_empty() {
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
    channels
        .iter()
        .map(|channel| u32::from(service.channel_status(GATEWAY, channel).tx_pending()))
        .sum()
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
    pub fn lost_frames(&self) -> u64 {
        self.rejected + self.waiting + self.unknown
    }
}
