//! The cycle of the bridge, and its frames without result.

use std::collections::HashMap;

use ecan_can_io::bridge::BusEvent;

use super::endpoint::LaneId;
use super::lane::{Lane, PendingFrame, failure_event};
use crate::context::{Result, note};
use crate::frames::{Event, Service, Ticket};

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

    use super::*;

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
