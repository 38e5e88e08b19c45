use std::collections::HashMap;

use crate::frames::Ticket;

/// Time limit of a transmit result: later the image with the result must be lost. Tickets repeat
/// after 65536 images, 65 s with the usual cycle.
const LIMIT_NS: u64 = 10_000_000_000;
const LOOK_NS: u64 = 1_000_000_000;

#[derive(Debug)]
pub struct InFlight<T> {
    frames: HashMap<Ticket, (u64, T)>,
    next_look_ns: u64,
}

impl<T> Default for InFlight<T> {
    fn default() -> Self {
        Self { frames: HashMap::with_capacity(4096), next_look_ns: 0 }
    }
}

impl<T> InFlight<T> {
    pub fn insert(&mut self, ticket: Ticket, frame: T, now_ns: u64) {
        self.frames.insert(ticket, (now_ns, frame));
    }

    pub fn remove(&mut self, ticket: Ticket) -> Option<T> {
        self.frames.remove(&ticket).map(|(_, frame)| frame)
    }

    /// Removes and returns old entries, and those whose result cannot arrive any more.
    pub fn forget(&mut self, now_ns: u64, can_arrive: impl Fn(&T) -> bool) -> Vec<T> {
        let is_look = now_ns >= self.next_look_ns;
        if is_look {
            self.next_look_ns = now_ns + LOOK_NS;
        }
        let is_over = |_: &Ticket, (taken_ns, frame): &mut (u64, T)| {
            !can_arrive(frame) || is_look && now_ns.saturating_sub(*taken_ns) >= LIMIT_NS
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
        frames.insert(ticket(1), "lost", start);
        frames.insert(ticket(2), "sent", start);
        frames.insert(ticket(3), "late", start + LOOK_NS);
        assert_eq!(frames.remove(ticket(2)), Some("sent"));
        assert_eq!(frames.forget(start + LIMIT_NS - 1, |_| true), [""; 0]);
        assert_eq!(frames.forget(start + LIMIT_NS - 1 + LOOK_NS, |_| true), ["lost"]);
        assert_eq!(frames.remove(ticket(1)), None);
        assert_eq!(frames.remove(ticket(3)), Some("late"));
        assert_eq!(frames.forget(u64::MAX - LOOK_NS, |_| true), [""; 0]);
        frames.insert(ticket(4), "cleared", start);
        assert_eq!(frames.forget(start, |_| false), ["cleared"]);
    }
}
