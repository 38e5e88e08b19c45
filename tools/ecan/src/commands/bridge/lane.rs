//! One channel of the bridge with its endpoints, and the order in which it serves them.

use std::collections::HashMap;

use ecan_can_io::bridge::{BusEvent, ClientFrame};
use ecan_mcan_port::LossWatch;
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::{ChannelState, ChannelStatus, ResultCode};

use super::endpoint::{Address, Endpoint, LOSSES, LaneId, TransmitGate};
use crate::context::{Result, note};
use crate::frames::{Event, LOSS_INTERVAL, Outcome, Service, Ticket};

/// A bus without progress for this time of reported status, despite pending frames, has no
/// acknowledging node.
const STALL_NS: u64 = 1_000_000_000;

/// A frame of a client of one endpoint.
#[derive(Clone, Copy, Debug)]
pub struct PendingFrame {
    endpoint: usize,
    pub sent: ClientFrame,
}

#[derive(Debug)]
pub struct Lane {
    pub id: LaneId,
    endpoints: Vec<Endpoint>,
    /// Reported losses of each endpoint.
    losses: Vec<[LossWatch; LOSSES]>,
    is_listening: bool,
    /// Frame that waits for space.
    waiting: Option<PendingFrame>,
    turns: RoundRobin,
    gate: TransmitGate,
    events: ChannelEvents,
    /// Status time of the gateway when it last accepted a frame, or had no pending frames.
    moved_ns: u64,
    status_ns: u64,
    /// Status time in which the channel had no pending frames.
    idle_ns: u64,
    is_stalled: bool,
}

impl Lane {
    pub fn new(id: LaneId, endpoints: Vec<Endpoint>, is_listening: bool) -> Self {
        Self {
            id,
            is_listening,
            waiting: None,
            turns: RoundRobin::default(),
            gate: TransmitGate::new(&endpoints),
            events: ChannelEvents::default(),
            losses: vec![[LossWatch::new(0, LOSS_INTERVAL); LOSSES]; endpoints.len()],
            moved_ns: 0,
            status_ns: 0,
            idle_ns: 0,
            is_stalled: false,
            endpoints,
        }
    }

    pub fn endpoints(&self) -> &[Endpoint] {
        &self.endpoints
    }

    pub fn addresses(&self) -> impl Iterator<Item = Address> {
        self.endpoints.iter().map(|endpoint| endpoint.address(self.id))
    }

    /// Accepts frames of clients from now on.
    pub fn start(&mut self) {
        self.gate.set_open(!self.is_listening, 0, &self.endpoints);
    }

    /// Follows the state of the channel: events, and whether frames can be sent.
    pub fn update(&mut self, service: &Service, now_ns: u64) {
        let is_ready = service.is_ready(self.id.gateway);
        let status = service.channel_status(self.id.gateway, self.id.channel);
        let time_ns = service.absolute_ns(now_ns);
        if is_ready {
            while let Some(event) = self.events.next(status) {
                self.report(event, time_ns);
            }
        }
        self.report_new_losses(now_ns);
        let before_ns = std::mem::replace(&mut self.status_ns, service.status_ns(self.id.gateway));
        if status.tx_pending() == 0 {
            self.idle_ns += self.status_ns - before_ns;
            if self.waiting.is_none() {
                self.moved_ns = self.status_ns;
            }
        }
        let was_stalled = self.is_stalled;
        self.is_stalled = self.status_ns - self.moved_ns >= STALL_NS;
        if self.is_stalled && !was_stalled {
            self.report(BusEvent::NotAcknowledged, time_ns);
        }
        let can_send = is_ready && !status.bus_off() && !self.is_stalled && !self.is_listening;
        let dropped = self.waiting.take_if(|_| !can_send);
        if let Some(dropped) = &dropped {
            self.fail(dropped, time_ns);
        }
        self.gate.set_open(can_send, time_ns, &self.endpoints);
    }

    /// Reports losses when they happen, each kind at most once per interval.
    fn report_new_losses(&mut self, now_ns: u64) {
        for (endpoint, reported) in self.endpoints.iter().zip(&mut self.losses) {
            for ((count, loss), reported) in endpoint.losses().into_iter().zip(reported) {
                let Some(new) = reported.next(count, now_ns) else { continue };
                let Address { protocol, address, .. } = endpoint.address(self.id);
                note(format_args!("# {protocol} bridge at {address}: {new} {loss}"));
            }
        }
    }

    /// Status time of the gateway in which the channel had no pending frames: the time in which the
    /// results of its frames arrive at the latest.
    pub fn idle_ns(&self) -> u64 {
        self.idle_ns
    }

    /// Rejects frames of clients from now on, and drops the waiting ones.
    pub fn close(&mut self, time_ns: u64) {
        let waiting = self.waiting.take();
        waiting.iter().for_each(|held| self.fail(held, time_ns));
        let queued: usize = self
            .endpoints
            .iter()
            .map(|endpoint| endpoint.clients().set_accepting(false, time_ns))
            .sum();
        let dropped = queued + waiting.iter().count();
        if dropped > 0 {
            note(format_args!("# {}: {dropped} client frames not sent before the end", self.id));
        }
    }

    /// Returns the next frame for the bus: first the one that waits for space.
    pub fn take(&mut self) -> Option<PendingFrame> {
        self.waiting.take().or_else(|| {
            self.turns.next(self.endpoints.len(), |endpoint| {
                let sent = self.endpoints.get(endpoint)?.clients().next_for_bus()?;
                Some(PendingFrame { endpoint, sent })
            })
        })
    }

    /// Keeps a frame without space for the next cycle.
    pub fn keep(&mut self, frame: PendingFrame) {
        self.waiting = Some(frame);
    }

    /// Passes a frame from the bus to all clients.
    pub fn deliver(&self, frame: &CanFrame, time_ns: u64) {
        self.endpoints.iter().for_each(|endpoint| endpoint.clients().deliver(frame, time_ns, None));
    }

    /// The gateway has reported a frame as sent: its sender receives the result, the others the
    /// frame.
    pub fn confirm(&mut self, held: &PendingFrame, time_ns: u64) {
        self.moved_ns = self.status_ns;
        for (number, endpoint) in self.endpoints.iter().enumerate() {
            match number == held.endpoint {
                true => endpoint.clients().confirm(&held.sent, time_ns),
                false => endpoint.clients().deliver(&held.sent.frame, time_ns, None),
            }
        }
    }

    /// A frame was not sent, or its result is unknown.
    pub fn fail(&self, held: &PendingFrame, time_ns: u64) {
        if let Some(endpoint) = self.endpoints.get(held.endpoint) {
            endpoint.clients().fail(&held.sent, time_ns);
        }
    }

    /// Reports an event to the CAN interfaces.
    pub fn report(&self, event: BusEvent, time_ns: u64) {
        self.endpoints.iter().for_each(|endpoint| endpoint.clients().report(event, None, time_ns));
    }

    /// Fails if an interface was removed.
    pub fn check(&self) -> Result {
        self.endpoints.iter().try_for_each(Endpoint::check)
    }

    /// Reports all losses at the end.
    pub fn report_losses(&self) {
        for endpoint in &self.endpoints {
            let Address { protocol, address, .. } = endpoint.address(self.id);
            for (count, loss) in endpoint.losses().into_iter().filter(|(count, _)| *count > 0) {
                note(format_args!("# {protocol} bridge at {address}: {count} {loss}"));
            }
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    Active,
    Warning,
    BusOff,
}

/// Detects events of a channel.
#[derive(Debug, Default)]
pub struct ChannelEvents {
    level: Option<Level>,
}

impl ChannelEvents {
    /// Returns the next event. A channel that leaves bus-off with a warning has two.
    pub fn next(&mut self, status: ChannelStatus) -> Option<BusEvent> {
        let now = match status.state() {
            _ if status.bus_off() => Level::BusOff,
            ChannelState::BusOff => Level::BusOff,
            _ if status.warn() => Level::Warning,
            ChannelState::Run | ChannelState::Listen => Level::Active,
            // The channel does not take part in its bus, or there is no status yet.
            _ => return None,
        };
        let before = self.level.replace(now).unwrap_or(Level::Active);
        match (before, now) {
            (Level::BusOff, Level::Active | Level::Warning) => {
                self.level = Some(Level::Active);
                Some(BusEvent::Restarted)
            }
            (Level::Warning, Level::Active) => Some(BusEvent::ErrorActive),
            (Level::Active, Level::Warning) => Some(BusEvent::ErrorWarning),
            (Level::Active | Level::Warning, Level::BusOff) => Some(BusEvent::BusOff),
            _ => None,
        }
    }
}

/// Event of a frame that the gateway did not send.
pub fn failure_event(outcome: Outcome) -> BusEvent {
    match outcome {
        Outcome::Result(ResultCode::BusBusy) => BusEvent::LostArbitration,
        Outcome::Result(ResultCode::TxFifoFull) => BusEvent::TransmitOverflow,
        _ => BusEvent::TransmitFailed,
    }
}

/// Takes from several sources in turn, so that none is starved.
#[derive(Debug, Default)]
pub struct RoundRobin {
    next: usize,
}

impl RoundRobin {
    /// Returns the next item of the first of `count` sources that has one, starting after the last
    /// source.
    pub fn next<T>(&mut self, count: usize, mut take: impl FnMut(usize) -> Option<T>) -> Option<T> {
        let (from, until) = (self.next.min(count), count);
        (from..until).chain(0..from).find_map(|source| {
            let taken = take(source)?;
            self.next = source + 1;
            Some(taken)
        })
    }
}

#[derive(Debug)]
pub struct Traffic {
    service: Service,
    lanes: Vec<Lane>,
    /// Client frames in the gateway, with their lanes.
    in_flight: InFlight<(usize, PendingFrame)>,
    /// Lane that sends first in the next cycle: all share the space of an image.
    first: usize,
}

impl Traffic {
    pub fn new(service: Service, lanes: Vec<Lane>) -> Self {
        Self { service, lanes, in_flight: InFlight::default(), first: 0 }
    }

    /// Runs until the user stops the command.
    pub fn run(&mut self) -> Result {
        let mut outcome = Ok(());
        while outcome.is_ok() && !self.service.is_interrupted() {
            outcome = self.cycle();
        }
        let now_ns = self.service.now_ns();
        let time_ns = self.service.absolute_ns(now_ns);
        self.lanes.iter_mut().for_each(|lane| lane.close(time_ns));
        let unknown = self.in_flight.forget(|_| None);
        self.report_unknown(unknown, now_ns);
        self.lanes.iter().for_each(Lane::report_losses);
        outcome.and(self.service.finish())
    }

    fn cycle(&mut self) -> Result {
        let cycle = self.service.begin();
        let time_ns = self.service.absolute_ns(cycle.now_ns);
        for gateway in 0..self.service.gateways() {
            if self.service.take_gap(gateway).is_some() {
                let lanes = self.lanes.iter().filter(|lane| lane.id.gateway == gateway);
                lanes.for_each(|lane| lane.report(BusEvent::ReceiveOverflow, time_ns));
            }
        }
        for arrival in &cycle.arrivals {
            let time_ns = self.service.absolute_ns(arrival.time_ns);
            match &arrival.event {
                Event::Frame(received) => {
                    let id = LaneId { gateway: received.gateway, channel: received.channel };
                    if let Some(lane) = self.lanes.iter().find(|lane| lane.id == id) {
                        lane.deliver(&received.frame, time_ns);
                    }
                }
                Event::Result { ticket, outcome } => {
                    let held = ticket.and_then(|ticket| self.in_flight.remove(ticket));
                    let Some((lane, held)) = held else { continue };
                    let Some(lane) = self.lanes.get_mut(lane) else { continue };
                    if outcome.is_success() {
                        lane.confirm(&held, time_ns);
                    } else {
                        note(format_args!("# {}: client frame lost: {outcome}", lane.id));
                        lane.report(failure_event(*outcome), time_ns);
                        lane.fail(&held, time_ns);
                    }
                }
            }
        }
        self.forget(cycle.now_ns);
        for lane in &mut self.lanes {
            lane.update(&self.service, cycle.now_ns);
        }
        self.send(cycle.now_ns);
        self.service.end(cycle)?;
        self.lanes.iter().try_for_each(Lane::check)
    }

    /// Forgets frames without result: old ones, and those of a gateway that is not ready, because
    /// results of frames before the loss of a session never arrive.
    fn forget(&mut self, now_ns: u64) {
        let Self { service, lanes, in_flight, .. } = self;
        let lane_ns = |(lane, _): &(usize, PendingFrame)| {
            let lane = lanes.get(*lane)?;
            service.is_ready(lane.id.gateway).then(|| lane.idle_ns())
        };
        let unknown = in_flight.forget(lane_ns);
        self.report_unknown(unknown, now_ns);
    }

    fn report_unknown(&self, unknown: Vec<(usize, PendingFrame)>, now_ns: u64) {
        if !unknown.is_empty() {
            note(format_args!("# {} client frames: transmit result unknown", unknown.len()));
        }
        let time_ns = self.service.absolute_ns(now_ns);
        for (lane, held) in unknown {
            if let Some(lane) = self.lanes.get(lane) {
                lane.report(BusEvent::TransmitFailed, time_ns);
                lane.fail(&held, time_ns);
            }
        }
    }

    /// Sends frames of the lanes in turn, until no lane has a frame that fits.
    fn send(&mut self, now_ns: u64) {
        self.first = (self.first + 1) % self.lanes.len().max(1);
        let (mut has_progress, mut without_result) = (true, Vec::new());
        while has_progress {
            has_progress = false;
            let (before, from) = self.lanes.split_at_mut(self.first);
            let numbers = (self.first..).take(from.len()).chain(0..);
            for (number, lane) in numbers.zip(from.iter_mut().chain(before)) {
                let Some(held) = lane.take() else { continue };
                match self.service.send(lane.id.gateway, lane.id.channel, &held.sent.frame) {
                    Ok(Some(ticket)) => {
                        let repeated =
                            self.in_flight.insert(ticket, (number, held), lane.idle_ns());
                        without_result.extend(repeated);
                        has_progress = true;
                    }
                    Ok(None) => lane.keep(held),
                    // An invalid frame of one client must not stop the others.
                    Err(error) => {
                        note(format_args!("# {}: client frame rejected: {error}", lane.id));
                        lane.fail(&held, self.service.absolute_ns(now_ns));
                        has_progress = true;
                    }
                }
            }
        }
        self.report_unknown(without_result, now_ns);
    }
}

/// Time limit of a transmit result, in time without pending frames in the channel: later the image
/// with the result must be lost. Tickets repeat after 65536 images, 65 s with the usual cycle.
const LIMIT_NS: u64 = 10_000_000_000;

/// Frames in gateways, with the time of their channel when the gateway took them.
#[derive(Debug)]
pub struct InFlight<T> {
    frames: HashMap<Ticket, (u64, T)>,
}

impl<T> Default for InFlight<T> {
    fn default() -> Self {
        Self { frames: HashMap::with_capacity(4096) }
    }
}

impl<T> InFlight<T> {
    /// Adds a frame. Returns an earlier one with the same ticket, whose result is unknown.
    #[must_use]
    pub fn insert(&mut self, ticket: Ticket, frame: T, channel_ns: u64) -> Option<T> {
        self.frames.insert(ticket, (channel_ns, frame)).map(|(_, earlier)| earlier)
    }

    pub fn remove(&mut self, ticket: Ticket) -> Option<T> {
        self.frames.remove(&ticket).map(|(_, frame)| frame)
    }

    /// Removes and returns old entries, and those whose result cannot arrive any more. `channel_ns`
    /// returns the time of a frame's channel, `None` if no result can arrive.
    pub fn forget(&mut self, channel_ns: impl Fn(&T) -> Option<u64>) -> Vec<T> {
        let is_over = |_: &Ticket, (taken_ns, frame): &mut (u64, T)| {
            channel_ns(frame).is_none_or(|now_ns| now_ns.saturating_sub(*taken_ns) >= LIMIT_NS)
        };
        self.frames.extract_if(is_over).map(|(_, (_, frame))| frame).collect()
    }
}

#[cfg(test)]
mod tests {
    use ecan_mcan_port::SendTicket;

    use super::{RoundRobin, *};

    #[test]
    fn status_changes_become_events_once() {
        let run = ChannelStatus::default().with_state(ChannelState::Run);
        let off = run.with_state(ChannelState::BusOff).with_bus_off(true);
        let mut events = ChannelEvents::default();
        let mut all = Vec::new();
        for status in
            [ChannelStatus::default(), run, run.with_warn(true), off, off, run.with_warn(true), run]
        {
            all.extend(std::iter::from_fn(|| events.next(status)));
        }
        let expected = [
            BusEvent::ErrorWarning,
            BusEvent::BusOff,
            BusEvent::Restarted,
            BusEvent::ErrorWarning,
            BusEvent::ErrorActive,
        ];
        assert_eq!(all, expected);
    }

    #[test]
    fn endless_source_starves_no_other() {
        let mut turns = RoundRobin::default();
        let mut rest = [usize::MAX, 2, 0, 3];
        let mut order = Vec::new();
        for _ in 0..9 {
            order.extend(turns.next(4, |source| {
                rest[source] = rest[source].checked_sub(1)?;
                Some(source)
            }));
        }
        assert_eq!(order, [0, 1, 3, 0, 1, 3, 0, 3, 0]);
        assert_eq!(turns.next(4, |_| None::<()>), None);
        assert_eq!(turns.next(0, Some), None);
    }

    #[test]
    fn entry_without_result_expires() {
        let ticket = |sequence| Ticket::from(SendTicket { slave: 0, sequence, index: 0 });
        let mut frames = InFlight::default();
        let start = 5 * LIMIT_NS;
        assert_eq!(frames.insert(ticket(1), "lost", start), None);
        assert_eq!(frames.insert(ticket(2), "sent", start), None);
        assert_eq!(frames.insert(ticket(3), "late", start + 1), None);
        assert_eq!(frames.remove(ticket(2)), Some("sent"));
        assert_eq!(frames.forget(|_| Some(start + LIMIT_NS - 1)), [""; 0]);
        assert_eq!(frames.forget(|_| Some(start + LIMIT_NS)), ["lost"]);
        assert_eq!(frames.remove(ticket(1)), None);
        assert_eq!(frames.remove(ticket(3)), Some("late"));
        assert_eq!(frames.forget(|_| Some(u64::MAX)), [""; 0]);
        assert_eq!(frames.insert(ticket(4), "cleared", start), None);
        assert_eq!(frames.insert(ticket(4), "same ticket", start), Some("cleared"));
        assert_eq!(frames.forget(|_| None), ["same ticket"]);
    }
}
