//! One channel of the bridge with its endpoints.

use ecan_bridge::{BusEvent, ClientFrame};
use ecan_protocol::can::CanFrame;

use crate::commands::bridge::channel_events::ChannelEvents;
use crate::commands::bridge::endpoint::{Address, Endpoint};
use crate::commands::bridge::lane_id::LaneId;
use crate::commands::bridge::round_robin::RoundRobin;
use crate::commands::bridge::transmit_gate::TransmitGate;
use crate::context::{Result, note};
use crate::frames::Service;

/// A bus without progress for this time, despite pending frames, has no acknowledging node.
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
    is_listening: bool,
    /// Frame that waits for space.
    waiting: Option<PendingFrame>,
    turns: RoundRobin,
    gate: TransmitGate,
    events: ChannelEvents,
    /// Time of the last accepted frame, or without pending frames.
    moved_ns: u64,
    is_stalled: bool,
}

impl Lane {
    pub fn new(id: LaneId, endpoints: Vec<Endpoint>, is_listening: bool) -> Self {
        Self {
            id,
            is_listening,
            waiting: None,
            turns: RoundRobin::default(),
            gate: TransmitGate::closed(id, &endpoints),
            events: ChannelEvents::default(),
            moved_ns: 0,
            is_stalled: false,
            endpoints,
        }
    }

    pub fn endpoints(&self) -> &[Endpoint] {
        &self.endpoints
    }

    pub fn addresses(&self) -> impl Iterator<Item = Address> {
        self.endpoints.iter().map(|it| it.address(self.id))
    }

    /// Accepts frames of clients from now on.
    pub fn start(&mut self, now_ns: u64) {
        self.moved_ns = now_ns;
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
        if self.waiting.is_none() && status.tx_pending() == 0 {
            self.moved_ns = now_ns;
        }
        let was_stalled = self.is_stalled;
        self.is_stalled = now_ns.saturating_sub(self.moved_ns) >= STALL_NS;
        if self.is_stalled && !was_stalled {
            self.report(BusEvent::NotAcknowledged, time_ns);
        }
        let can_send = is_ready && !status.bus_off() && !self.is_stalled && !self.is_listening;
        let dropped = self.waiting.take_if(|_| !can_send);
        if let Some(dropped) = &dropped {
            self.fail(dropped);
        }
        self.gate.set_open(can_send, dropped.iter().count(), &self.endpoints);
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
        self.endpoints.iter().for_each(|it| it.clients().deliver(frame, time_ns, None));
    }

    /// The gateway has reported a frame as sent: its sender receives the result, the others the
    /// frame.
    pub fn confirm(&mut self, held: &PendingFrame, time_ns: u64, now_ns: u64) {
        self.moved_ns = now_ns;
        for (number, endpoint) in self.endpoints.iter().enumerate() {
            match number == held.endpoint {
                true => endpoint.clients().confirm(&held.sent, time_ns),
                false => endpoint.clients().deliver(&held.sent.frame, time_ns, None),
            }
        }
    }

    /// A frame was not sent, or its result is unknown.
    pub fn fail(&self, held: &PendingFrame) {
        if let Some(endpoint) = self.endpoints.get(held.endpoint) {
            endpoint.clients().fail(&held.sent);
        }
    }

    /// Reports an event to the CAN interfaces.
    pub fn report(&self, event: BusEvent, time_ns: u64) {
        self.endpoints.iter().for_each(|it| it.clients().report(event, None, time_ns));
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
