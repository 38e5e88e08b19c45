//! One channel of the bridge with its endpoints, and the order in which it serves them.

use ecan_can_io::bridge::{BusEvent, ClientFrame};
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::{ChannelState, ChannelStatus, ResultCode};

use super::endpoint::{Address, Endpoint, LaneId, TransmitGate};
use crate::context::{Result, note};
use crate::frames::{Losses, Outcome, Service};

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
    /// Rejected and closed connections of each endpoint.
    lost_connections: Vec<(Losses, Losses)>,
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
            gate: TransmitGate::new(id, &endpoints),
            events: ChannelEvents::default(),
            lost_connections: endpoints.iter().map(|_| Default::default()).collect(),
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
        self.gate.set_open(!self.is_listening, (0, 0), &self.endpoints);
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
        self.report_connections(now_ns);
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
        self.gate.set_open(can_send, (dropped.iter().count(), time_ns), &self.endpoints);
    }

    /// Reports connections without a place.
    fn report_connections(&mut self, now_ns: u64) {
        for (endpoint, (rejected, silent)) in self.endpoints.iter().zip(&mut self.lost_connections)
        {
            let clients = endpoint.clients();
            let (counted, places) = (clients.statistics(), clients.max_clients());
            let report = |text: String| {
                let Address { protocol, address, .. } = endpoint.address(self.id);
                note(format_args!("# {protocol} bridge at {address}: {text}"));
            };
            if let Some(count) = rejected.next(counted.rejected_clients, now_ns) {
                report(format!(
                    "{count} connections rejected: {places} clients are connected; set --max-clients"
                ));
            }
            if let Some(count) = silent.next(counted.silent_clients, now_ns) {
                report(format!("{count} connections closed: their clients did not open the bus"));
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

    pub fn report_losses(&self) {
        for endpoint in &self.endpoints {
            let Address { protocol, address, .. } = endpoint.address(self.id);
            for loss in endpoint.losses() {
                note(format_args!("# {protocol} bridge at {address}: {loss}"));
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

#[cfg(test)]
mod tests {
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
}
