//! Drain of the frames that were sent to a drive before its activation.
//!
//! The gateway sends what it got in order and tells how many frames wait (manual 7). So once no
//! more frames wait than were confirmed *after* the last target, the target is not among them.
//! That needs no pause of the channel: SYNC, SDO and heartbeats may go on.

use super::terms::{ChannelView, PathStatus};

/// Value at which the gateway's count of waiting frames saturates.
const SATURATED: u8 = 7;

/// Follows the channel after the last target was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Drain {
    /// Frames confirmed when the last target was certainly confirmed or discarded.
    base: Option<u64>,
    /// New channel statuses since then.
    statuses: u16,
}

impl Drain {
    /// One cycle in which no target of the axis was sent before. Gives whether nothing that was
    /// sent before the drain began can reach the drive any more; at least `minimum` new statuses
    /// have been seen then.
    pub(crate) fn step(&mut self, path: &PathStatus, minimum: u16) -> bool {
        if !path.is_ready || path.is_unconfirmed || path.discarded {
            *self = Self::default();
            return false;
        }
        let base = *self.base.get_or_insert(path.confirmed);
        let (pending, pressure) = match path.channel {
            ChannelView::NotSeen => return false,
            ChannelView::BusOff | ChannelView::NotRunning => {
                // What waits here may go out when the channel is back.
                self.statuses = 0;
                return false;
            }
            ChannelView::Running { pending, pressure } => (pending, pressure),
        };
        self.statuses = self.statuses.saturating_add(1);
        if self.statuses <= minimum || pressure || pending >= SATURATED {
            return false;
        }
        path.covered.checked_sub(base).is_some_and(|later| u64::from(pending) <= later)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(pending: u8, confirmed: u64, covered: u64) -> PathStatus {
        let channel = ChannelView::Running { pending, pressure: false };
        PathStatus { channel, confirmed, covered, ..PathStatus::CLEAR }
    }

    #[test]
    fn idle_channel_drains_when_its_status_covers_everything() {
        let mut drain = Drain::default();
        assert!(!drain.step(&path(0, 10, 8), 2), "the status is older than the last image");
        assert!(!drain.step(&path(0, 10, 9), 2));
        assert!(drain.step(&path(0, 10, 10), 2));
    }

    #[test]
    fn waiting_frame_delays_the_drain() {
        let mut drain = Drain::default();
        for _ in 0..10 {
            assert!(!drain.step(&path(1, 10, 10), 2));
        }
        assert!(drain.step(&path(0, 10, 10), 2));
    }

    #[test]
    fn later_frames_do_not_delay_the_drain() {
        let mut drain = Drain::default();
        // One SYNC a cycle, one always waits.
        assert!(!drain.step(&path(1, 10, 8), 2));
        assert!(!drain.step(&path(1, 11, 9), 2));
        assert!(!drain.step(&path(1, 12, 10), 2), "the one that waits may be the target");
        assert!(drain.step(&path(1, 13, 11), 2), "the one that waits came after it");
    }

    #[test]
    fn saturated_count_delays_the_drain() {
        let mut drain = Drain::default();
        for cycle in 0..100 {
            assert!(!drain.step(&path(7, 10 + cycle, 8 + cycle), 2));
        }
        assert!(drain.step(&path(6, 110, 108), 2));
    }

    #[test]
    fn bus_off_and_pressure_delay_the_drain() {
        let mut drain = Drain::default();
        let off = PathStatus { channel: ChannelView::BusOff, ..path(0, 10, 10) };
        let pressed = ChannelView::Running { pending: 0, pressure: true };
        for _ in 0..10 {
            assert!(!drain.step(&off, 1));
            assert!(!drain.step(&PathStatus { channel: pressed, ..path(0, 10, 10) }, 1));
        }
        assert!(drain.step(&path(0, 10, 10), 1));
    }

    #[test]
    fn unconfirmed_image_and_new_session_restart_the_drain() {
        let mut drain = Drain::default();
        drain.step(&path(0, 10, 10), 1);
        assert!(!drain.step(&PathStatus { is_unconfirmed: true, ..path(0, 10, 10) }, 1));
        assert!(!drain.step(&path(0, 11, 10), 1), "confirmed only now");
        assert!(!drain.step(&path(0, 11, 10), 1), "not covered");
        assert!(drain.step(&path(0, 11, 11), 1));
        assert!(!drain.step(&PathStatus { is_ready: false, ..path(0, 11, 11) }, 1));
        assert!(!drain.step(&path(0, 11, 11), 1));
    }
}
