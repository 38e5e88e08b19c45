//! Sequence numbers of received images.

/// Relation of the sequence number of an image to the previous one (manual 6.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Arrival {
    /// The first image, or one with a lower number, as after a restart of the sender: losses are
    /// unknown.
    First,
    /// The expected number.
    Next,
    /// The same image again; its packets were already received.
    Repeated,
    /// A new image; others before it were lost.
    Gap {
        /// Number of lost images, at least 1.
        lost: u16,
    },
}

impl Arrival {
    /// True if the image has new packets.
    #[inline]
    pub const fn is_new(self) -> bool {
        !matches!(self, Self::Repeated)
    }
}

/// Follows the sequence numbers of one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SequenceTracker {
    // Zero is a valid number, so "none received yet" is separate.
    last: Option<u16>,
}

impl SequenceTracker {
    /// Creates a tracker without an image.
    pub const fn new() -> Self {
        Self { last: None }
    }

    /// Compares the number of a valid image with the previous one, and stores it.
    #[inline]
    pub const fn observe(&mut self, sequence: u16) -> Arrival {
        let arrival = match self.last {
            None => Arrival::First,
            Some(last) => match sequence.wrapping_sub(last) {
                0 => Arrival::Repeated,
                1 => Arrival::Next,
                step @ 2..=0x7FFF => Arrival::Gap { lost: step - 1 },
                _ => Arrival::First,
            },
        };
        self.last = Some(sequence);
        arrival
    }

    /// The last number.
    pub const fn last(&self) -> Option<u16> {
        self.last
    }

    /// Resets the tracker, as after a session reset of the sender.
    pub const fn reset(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::{Arrival, SequenceTracker};

    #[test]
    fn zero_is_a_number_like_any_other() {
        let mut tracker = SequenceTracker::new();
        assert_eq!(tracker.observe(0), Arrival::First);
        assert_eq!(tracker.observe(0), Arrival::Repeated);
        assert_eq!(tracker.observe(1), Arrival::Next);
    }

    #[test]
    fn gaps_are_counted_over_the_wrap() {
        let mut tracker = SequenceTracker::new();
        tracker.observe(0xFFFE);
        assert_eq!(tracker.observe(0xFFFF), Arrival::Next);
        assert_eq!(tracker.observe(0), Arrival::Next);
        assert_eq!(tracker.observe(3), Arrival::Gap { lost: 2 });
    }

    #[test]
    fn step_back_is_a_new_start() {
        let mut tracker = SequenceTracker::new();
        tracker.observe(500);
        assert_eq!(tracker.observe(1), Arrival::First);
        assert_eq!(tracker.observe(2), Arrival::Next);
        tracker.reset();
        assert_eq!(tracker.last(), None);
        assert_eq!(tracker.observe(2), Arrival::First);
    }
}
