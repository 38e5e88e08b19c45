//! How many frames a channel's transmit queue in the gateway can still take.
//!
//! The gateway does not say how full its queue is beyond "7 or more" and a pressure bit of unknown
//! threshold (manual 7), and what it says is two images old when it arrives. But only frames of
//! this host are in the queue. So all frames sent since the last exact count are added to that
//! count, and the sum stays below the queue's depth: no threshold is assumed.

use ecan_protocol::image::ChannelStatus;

/// Depth of the gateway's transmit queue where the device does not tell (manual 13.8, SI 29).
pub(crate) const DEFAULT_DEPTH: u16 = 64;

/// Where the pending count of the status word saturates.
const SATURATED: u8 = 7;

#[derive(Debug, Clone)]
pub(crate) struct TransmitWindow {
    depth: u16,
    /// Frames of the image being filled, of the last one, of the one before, and of older ones
    /// that no fresh status has covered yet.
    filling: u16,
    last: u16,
    before: u16,
    older: u16,
    /// Frames in the queue by the last exact count.
    pending: u16,
    status: ChannelStatus,
}

impl TransmitWindow {
    pub(crate) fn new(depth: u16) -> Self {
        Self {
            depth,
            filling: 0,
            last: 0,
            before: 0,
            older: 0,
            pending: 0,
            status: ChannelStatus::default(),
        }
    }

    /// Frames of the image being filled.
    pub(crate) fn filling(&self) -> u16 {
        self.filling
    }

    /// Whether the channel takes one more frame.
    #[inline]
    pub(crate) fn accepts_frames(&self) -> bool {
        !self.is_bus_off() && self.has_room()
    }

    /// Whether one more frame fits for sure.
    #[inline]
    pub(crate) fn has_room(&self) -> bool {
        let unseen = [self.filling, self.last, self.before, self.older];
        let at_most = unseen.into_iter().fold(self.pending, u16::saturating_add);
        !self.status.tx_pressure() && at_most < self.depth
    }

    /// Whether the channel is off the bus, where the gateway throws frames away.
    pub(crate) fn is_bus_off(&self) -> bool {
        self.status.bus_off()
    }

    #[inline]
    pub(crate) fn frame_added(&mut self) {
        self.filling = self.filling.saturating_add(1);
    }

    /// The image being filled was published.
    pub(crate) fn published(&mut self) {
        self.older = self.older.saturating_add(self.before);
        self.before = self.last;
        self.last = std::mem::take(&mut self.filling);
    }

    /// The image being filled was given up.
    pub(crate) fn abandoned(&mut self) {
        self.filling = 0;
    }

    /// A fresh TxPDO brought a status: it covers all but the last two images. Only a count that is
    /// not saturated tells how many frames are left.
    pub(crate) fn status(&mut self, status: ChannelStatus) {
        self.status = status;
        if status.tx_pending() < SATURATED {
            self.pending = status.tx_pending().into();
            self.older = 0;
        }
    }

    /// The gateway starts anew; it was out of service for long enough to work its queue off.
    pub(crate) fn reset(&mut self) {
        *self = Self::new(self.depth);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fill(window: &mut TransmitWindow) -> u16 {
        let mut taken = 0;
        while window.has_room() {
            window.frame_added();
            taken += 1;
        }
        taken
    }

    #[test]
    fn a_burst_stops_at_the_depth_whatever_the_images() {
        let mut window = TransmitWindow::new(64);
        assert_eq!(fill(&mut window), 64);
        window.published();
        assert_eq!(fill(&mut window), 0);
    }

    #[test]
    fn frames_count_until_a_status_can_have_seen_them() {
        let mut window = TransmitWindow::new(64);
        fill(&mut window);
        window.published();
        window.status(ChannelStatus::default());
        assert!(!window.has_room(), "the status is older than the image");
        window.published();
        window.status(ChannelStatus::default());
        assert!(!window.has_room());
        window.published();
        window.status(ChannelStatus::default());
        assert!(window.has_room(), "the queue is known to be empty now");
    }

    #[test]
    fn pressure_stops_the_channel_and_its_end_frees_it() {
        let mut window = TransmitWindow::new(64);
        window.status(ChannelStatus::default().with_tx_pressure(true));
        assert!(!window.has_room());
        window.status(ChannelStatus::default());
        assert!(window.has_room());
    }

    #[test]
    fn a_saturated_count_keeps_all_frames_since_the_last_exact_one() {
        let mut window = TransmitWindow::new(64);
        window.status(ChannelStatus::default().with_tx_pending(5));
        for _ in 0..10 {
            for _ in 0..5 {
                assert!(window.has_room());
                window.frame_added();
            }
            window.published();
            window.status(ChannelStatus::default().with_tx_pending(7));
        }
        assert_eq!(fill(&mut window), 64 - 5 - 50);
        window.published();
        window.published();
        window.published();
        window.status(ChannelStatus::default().with_tx_pending(6));
        assert_eq!(fill(&mut window), 58);
    }

    #[test]
    fn counts_never_overflow() {
        let mut window = TransmitWindow::new(64);
        for _ in 0..70_000 {
            window.frame_added();
            window.published();
        }
        assert!(!window.has_room());
    }

    #[test]
    fn without_status_frames_never_age_out() {
        let mut window = TransmitWindow::new(64);
        for _ in 0..64 {
            assert!(window.has_room());
            window.frame_added();
            window.published();
        }
        assert!(!window.has_room());
    }
}
