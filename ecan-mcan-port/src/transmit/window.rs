//! Free space in a channel's transmit queue in the gateway.
//!
//! The gateway reports the fill level only up to "7 or more", a pressure bit of unknown threshold
//! (manual 7), and both two images late. Only frames of this host are in the queue. Therefore all
//! frames sent since the last exact count are added to that count, and the sum stays below the
//! queue's depth: no threshold is assumed.

use ecan_protocol::image::ChannelStatus;

/// Depth of the gateway's transmit queue if the device does not report it (manual 13.8, SI 29).
pub(crate) const DEFAULT_DEPTH: u16 = 64;

/// Value at which the pending count of the status word saturates.
const SATURATED: u8 = 7;

#[derive(Debug, Clone, Default)]
pub(crate) struct TransmitWindow {
    depth: u16,
    /// Frames of the image being filled, of the last one, of the one before, and of older ones that no
    /// new status includes.
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
        Self { depth, ..Self::default() }
    }

    pub(crate) fn filling(&self) -> u16 {
        self.filling
    }

    /// Returns whether the channel accepts one more frame.
    #[inline]
    pub(crate) fn accepts_frames(&self) -> bool {
        !self.is_bus_off() && self.has_room()
    }

    /// Returns whether one more frame fits in any case.
    #[inline]
    pub(crate) fn has_room(&self) -> bool {
        let parts = [self.pending, self.filling, self.last, self.before, self.older];
        let at_most: u32 = parts.into_iter().map(u32::from).sum();
        !self.status.tx_pressure() && at_most < u32::from(self.depth)
    }

    pub(crate) fn is_bus_off(&self) -> bool {
        self.status.bus_off()
    }

    #[inline]
    pub(crate) fn add_frame(&mut self) {
        // infallible: an image holds 255 frames at most
        self.filling = self.filling.wrapping_add(1);
    }

    pub(crate) fn on_published(&mut self) {
        self.older = self.older.saturating_add(self.before);
        self.before = self.last;
        self.last = std::mem::take(&mut self.filling);
    }

    pub(crate) fn abandon_image(&mut self) {
        self.filling = 0;
    }

    /// Status of a new TxPDO: it includes all but the last two images. Only a count that is not
    /// saturated is exact.
    #[inline]
    pub(crate) fn status(&mut self, status: ChannelStatus) {
        self.status = status;
        if status.tx_pending() < SATURATED {
            self.pending = status.tx_pending().into();
            self.older = 0;
        }
    }

    /// A new session: the gateway has had time to empty its queue.
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
            window.add_frame();
            taken += 1;
        }
        taken
    }

    #[test]
    fn burst_stops_at_the_queue_depth() {
        let mut window = TransmitWindow::new(64);
        assert_eq!(fill(&mut window), 64);
        window.on_published();
        assert_eq!(fill(&mut window), 0);
    }

    #[test]
    fn frames_count_until_a_status_includes_them() {
        let mut window = TransmitWindow::new(64);
        fill(&mut window);
        window.on_published();
        window.status(ChannelStatus::default());
        assert!(!window.has_room(), "the status is older than the image");
        window.on_published();
        window.status(ChannelStatus::default());
        assert!(!window.has_room());
        window.on_published();
        window.status(ChannelStatus::default());
        assert!(window.has_room(), "the queue is known to be empty now");
    }

    #[test]
    fn pressure_stops_the_channel() {
        let mut window = TransmitWindow::new(64);
        window.status(ChannelStatus::default().with_tx_pressure(true));
        assert!(!window.has_room());
        window.status(ChannelStatus::default());
        assert!(window.has_room());
    }

    #[test]
    fn saturated_count_keeps_frames_since_the_last_exact_one() {
        let mut window = TransmitWindow::new(64);
        window.status(ChannelStatus::default().with_tx_pending(5));
        for _ in 0..10 {
            for _ in 0..5 {
                assert!(window.has_room());
                window.add_frame();
            }
            window.on_published();
            window.status(ChannelStatus::default().with_tx_pending(7));
        }
        assert_eq!(fill(&mut window), 64 - 5 - 50);
        window.on_published();
        window.on_published();
        window.on_published();
        window.status(ChannelStatus::default().with_tx_pending(6));
        assert_eq!(fill(&mut window), 58);
    }

    #[test]
    fn counts_never_overflow() {
        let mut window = TransmitWindow::new(64);
        for _ in 0..70_000 {
            window.add_frame();
            window.on_published();
        }
        assert!(!window.has_room());
    }

    #[test]
    fn frames_without_status_count_forever() {
        let mut window = TransmitWindow::new(64);
        for _ in 0..64 {
            assert!(window.has_room());
            window.add_frame();
            window.on_published();
        }
        assert!(!window.has_room());
    }
}
