//! Error counters and error states (ISO 11898-1, fault confinement).

use ecan_protocol::can::Phase;

const WARNING_LIMIT: u16 = 96;
const PASSIVE_LIMIT: u16 = 128;
/// Transmit error count from which a station is bus-off.
const BUS_OFF_LIMIT: u16 = 256;
/// Counting beyond the passive limit has no effect.
const REC_MAX: u16 = 255;
/// Receive error counter of an error-passive receiver after a good frame; the standard allows 119
/// to 127.
const REC_AFTER_PASSIVE: u16 = 127;

/// Error state of a station.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ErrorState {
    /// Error active, both counters below 96.
    #[default]
    Active,
    /// Error active, a counter of 96 or more.
    Warning,
    /// Error passive: a counter of 128 or more. Its error flags do not disturb others.
    Passive,
    /// Bus-off: the transmit error counter reached 256.
    BusOff,
}

/// Error that a station detected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BusError {
    /// Stuff error: six equal bits. Also caused by another station's error flag.
    Stuff,
    /// ACK error: no station acknowledged the frame.
    Ack,
    /// Bit error: a recessive bit was sent, a dominant one was read back. Also caused by another
    /// station's error flag.
    Bit1,
    /// Bit error: a dominant bit was sent, a recessive one was read back.
    Bit0,
    /// Form error. Also caused by an FD frame at a classic station.
    Form,
}

/// An error with the phase of the frame in which it was detected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DetectedError {
    /// The error.
    pub error: BusError,
    /// The data phase is that of an FD frame with bit rate switch.
    pub phase: Phase,
}

impl DetectedError {
    pub(super) const fn nominal(error: BusError) -> Self {
        Self { error, phase: Phase::Nominal }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ErrorCounters {
    pub tec: u16,
    pub rec: u16,
    bus_off: bool,
}

impl ErrorCounters {
    pub(super) const fn state(&self) -> ErrorState {
        if self.bus_off {
            ErrorState::BusOff
        } else if self.is_passive() {
            ErrorState::Passive
        } else if self.tec >= WARNING_LIMIT || self.rec >= WARNING_LIMIT {
            ErrorState::Warning
        } else {
            ErrorState::Active
        }
    }

    pub(super) const fn is_bus_off(&self) -> bool {
        self.bus_off
    }

    pub(super) const fn is_passive(&self) -> bool {
        self.tec >= PASSIVE_LIMIT || self.rec >= PASSIVE_LIMIT
    }

    pub(super) const fn sent(&mut self) {
        self.tec = self.tec.saturating_sub(1);
    }

    pub(super) const fn received(&mut self) {
        self.rec =
            if self.rec >= PASSIVE_LIMIT { REC_AFTER_PASSIVE } else { self.rec.saturating_sub(1) };
    }

    /// The transmitter's error flag adds eight; bus-off from 256.
    pub(super) const fn send_failed(&mut self) {
        self.tec += 8;
        if self.tec >= BUS_OFF_LIMIT {
            self.leave_bus();
        }
    }

    pub(super) fn receive_failed(&mut self, points: u16) {
        self.rec = REC_MAX.min(self.rec + points);
    }

    pub(super) const fn leave_bus(&mut self) {
        self.tec = BUS_OFF_LIMIT;
        self.bus_off = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_failures_are_passive_thirty_two_bus_off() {
        let mut counters = ErrorCounters::default();
        let mut seen = Vec::new();
        for n in 1..=32 {
            let before = counters.state();
            counters.send_failed();
            if counters.state() != before {
                seen.push((n, counters.state()));
            }
        }
        assert_eq!(
            seen,
            [(12, ErrorState::Warning), (16, ErrorState::Passive), (32, ErrorState::BusOff)]
        );
    }

    #[test]
    fn good_frame_ends_passive_state_of_receiver() {
        let mut counters = ErrorCounters::default();
        counters.receive_failed(300);
        assert_eq!(counters.state(), ErrorState::Passive);
        counters.received();
        assert_eq!(counters.rec, 127);
        assert_eq!(counters.state(), ErrorState::Warning);
        counters.received();
        assert_eq!(counters.rec, 126);
    }
}
