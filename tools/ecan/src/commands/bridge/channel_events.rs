//! Events of a channel for CAN interfaces, from its status.

use ecan_can_io::bridge::BusEvent;
use ecan_protocol::image::{ChannelState, ChannelStatus, ResultCode};

use crate::frames::Outcome;

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
pub fn of_failure(outcome: Outcome) -> BusEvent {
    match outcome {
        Outcome::Result(ResultCode::BusBusy) => BusEvent::LostArbitration,
        Outcome::Result(ResultCode::TxFifoFull) => BusEvent::TransmitOverflow,
        _ => BusEvent::TransmitFailed,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
