use std::collections::HashMap;

use crate::frames::Ticket;

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
