//! Node guarding and life guarding of a drive (CiA 301, 7.2.8.3.2.1).

use ecan_canopen::{GuardResponse, NmtState, object};

use super::dictionary::Dictionary;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Guarding {
    /// Toggle bit of the next response.
    toggle: bool,
    /// Life time, 0x100C times 0x100D; 0 disables life guarding.
    life_ns: u64,
    /// Time at which the host is lost; `None` until the first request.
    deadline: Option<u64>,
    is_lost: bool,
}

impl Guarding {
    /// Communication starts: the first response has toggle bit 0.
    pub(super) fn restart(&mut self) {
        *self = Self { life_ns: self.life_ns, ..Self::default() };
    }

    /// Reads the life time; a new one runs from the next request.
    pub(super) fn load(&mut self, objects: &Dictionary) {
        let number = |index| objects.unsigned16(index, 0);
        let life_ms = number(object::GUARD_TIME) * number(object::LIFE_TIME_FACTOR);
        let life_ns = life_ms * 1_000_000;
        if life_ns != self.life_ns {
            self.life_ns = life_ns;
            self.deadline = None;
        }
    }

    /// Receives a request; returns the response, and whether the host had been lost.
    pub(super) fn request(&mut self, now: u64, state: NmtState) -> ([u8; 1], bool) {
        let response = GuardResponse { toggle: self.toggle, state };
        self.toggle = !self.toggle;
        self.deadline = (self.life_ns > 0).then(|| now.saturating_add(self.life_ns));
        (response.to_bytes(), std::mem::take(&mut self.is_lost))
    }

    /// Returns whether the host is lost since this call.
    pub(super) fn take_late(&mut self, now: u64) -> bool {
        let is_late = self.deadline.take_if(|at| *at <= now).is_some();
        self.is_lost |= is_late;
        is_late
    }

    pub(super) const fn next_event(&self) -> Option<u64> {
        self.deadline
    }
}
