//! Sequence numbers of received images.

/// How an image's sequence number follows the one before (manual 6.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Arrival {
    /// The first image, or one whose number went back, as after a restart of the sender: nothing
    /// can be said about losses.
    First,
    /// The number that was due.
    Next,
    /// The same image again; its packets are known.
    Repeated,
    /// A new image, with others lost before it.
    Gap {
        /// How many numbers are missing, at least 1.
        lost: u16,
    },
}

impl Arrival {
    /// Whether the image holds packets not seen before.
    #[inline]
    #[must_use]
    pub const fn is_new(self) -> bool {
        !matches!(self, Self::Repeated)
    }
}

/// Follows the sequence numbers of one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SequenceTracker {
    // Zero is a valid number, so "none seen yet" needs its own mark.
    last: Option<u16>,
}

impl SequenceTracker {
    /// A tracker that has seen no image.
    #[must_use]
    pub const fn new() -> Self {
        Self { last: None }
    }

    /// Judges the number of an image that was received intact, and remembers it.
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

    /// The number observed last.
    #[must_use]
    pub const fn last(&self) -> Option<u16> {
        self.last
    }

    /// Forgets the past, as after a session reset of the sender.
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
    fn a_step_back_is_a_new_start() {
        let mut tracker = SequenceTracker::new();
        tracker.observe(500);
        assert_eq!(tracker.observe(1), Arrival::First);
        assert_eq!(tracker.observe(2), Arrival::Next);
        tracker.reset();
        assert_eq!(tracker.last(), None);
        assert_eq!(tracker.observe(2), Arrival::First);
    }
}
