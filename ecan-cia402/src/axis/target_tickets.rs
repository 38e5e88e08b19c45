//! Sent targets whose transmit result is pending.

use ecan_mcan_port::SendTicket;

/// Most pending results; older ones are forgotten.
const CAPACITY: usize = 8;

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TargetTickets {
    tickets: [Option<SendTicket>; CAPACITY],
    next: usize,
}

impl TargetTickets {
    pub(crate) fn insert(&mut self, ticket: SendTicket) {
        if let Some(slot) = self.tickets.get_mut(self.next) {
            *slot = Some(ticket);
        }
        self.next = (self.next + 1) % CAPACITY;
    }

    pub(crate) fn remove(&mut self, ticket: SendTicket) -> bool {
        let slot = self.tickets.iter_mut().find(|slot| **slot == Some(ticket));
        slot.is_some_and(|slot| slot.take().is_some())
    }
}
