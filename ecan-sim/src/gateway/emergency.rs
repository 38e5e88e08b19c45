//! CoE emergencies that wait for the master (ETG.1000.6, CiA 301).
//!
//! The manual specifies no emergencies. The codes are those of CiA 301 for the same events. A front
//! end without mailbox bytes never fetches any; a full queue drops the oldest.

use std::collections::VecDeque;

use ecan_protocol::device::AlStatusCode;

const KEPT: usize = 8;

mod code {
    pub(super) const COMMUNICATION: u16 = 0x8100;
    /// Life guarding: expected messages are missing.
    pub(super) const LIFE_GUARD: u16 = 0x8130;
    pub(super) const RECOVERED: u16 = 0x8140;
    pub(super) const PROTOCOL: u16 = 0x8200;
}

const COMMUNICATION_ERROR: u8 = 0x11;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Emergency {
    pub(crate) code: u16,
    pub(crate) register: u8,
    pub(crate) data: [u8; 5],
}

impl Emergency {
    /// A channel went bus-off; its number (0 to 3) is in the first byte.
    pub(super) fn bus_off(channel: usize) -> Self {
        Self::of_channel(code::COMMUNICATION, COMMUNICATION_ERROR, channel)
    }

    /// A channel takes part in its bus again; its number is in the first byte.
    pub(super) fn bus_off_recovered(channel: usize) -> Self {
        Self::of_channel(code::RECOVERED, 0, channel)
    }

    fn of_channel(code: u16, register: u8, channel: usize) -> Self {
        Self { code, register, data: [channel.to_le_bytes()[0], 0, 0, 0, 0] }
    }

    /// Error code, error register and data.
    pub(crate) fn message(self) -> [u8; 8] {
        let ([low, high], [a, b, c, d, e]) = (self.code.to_le_bytes(), self.data);
        [low, high, self.register, a, b, c, d, e]
    }

    /// The slave fell back on its own; the AL status code is in the first two bytes.
    pub(super) fn al_error(status: AlStatusCode) -> Self {
        let code = match status {
            AlStatusCode::SM_WATCHDOG => code::LIFE_GUARD,
            _ => code::PROTOCOL,
        };
        let [low, high] = status.0.to_le_bytes();
        Self { code, register: COMMUNICATION_ERROR, data: [low, high, 0, 0, 0] }
    }
}

#[derive(Clone, Debug)]
pub(super) struct EmergencyQueue {
    pub(super) waiting: VecDeque<Emergency>,
}

impl EmergencyQueue {
    pub(super) fn new() -> Self {
        Self { waiting: VecDeque::with_capacity(KEPT) }
    }

    pub(super) fn push(&mut self, emergency: Emergency) {
        if self.waiting.len() >= KEPT {
            self.waiting.pop_front();
        }
        self.waiting.push_back(emergency);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oldest_emergency_is_dropped() {
        let mut queue = EmergencyQueue::new();
        for channel in 0..KEPT + 3 {
            queue.push(Emergency::bus_off(channel));
        }
        assert_eq!(queue.waiting.len(), KEPT);
        assert_eq!(queue.waiting.front(), Some(&Emergency::bus_off(3)));
        assert_eq!(queue.waiting.back(), Some(&Emergency::bus_off(KEPT + 2)));
    }

    #[test]
    fn watchdog_emergency_has_its_own_code() {
        let watchdog = Emergency::al_error(AlStatusCode::SM_WATCHDOG);
        assert_eq!((watchdog.code, watchdog.data), (0x8130, [0x1B, 0, 0, 0, 0]));
        let sync = Emergency::al_error(AlStatusCode::FATAL_SYNC);
        assert_eq!((sync.code, sync.data), (0x8200, [0x2C, 0, 0, 0, 0]));
    }
}
