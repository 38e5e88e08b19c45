//! Sequence numbers of TxPDO images over sessions: images lost before each one.
//!
//! Within a session a gap is exact. Over an outage the gateway may have started its numbers again at
//! 1: by a reboot, or by the session reset of the verification (manual 13.2). Then images before that are
//! unknown; at most each exchange without a known result has taken one, since the gateway publishes
//! the next image when the last one was read (single buffer, manual 5.3).

use ecan_protocol::image::{Arrival, SequenceTracker};

/// Images that a gateway published before a new one, and that did not arrive.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct MissingImages {
    /// By the sequence.
    pub(crate) lost: u16,
    /// At most, before the gateway started its sequence again.
    pub(crate) unknown: u64,
}

/// Exchanges after an image that count as possible even if the master reports the slave as absent:
/// its report may be wrong for some cycles.
const ALWAYS_POSSIBLE: u64 = 32;

#[derive(Debug, Clone, Default)]
pub(crate) struct ImageNumbering {
    tracker: SequenceTracker,
    /// Exchanges without a known result since the last image, and those of them that may have taken
    /// another image.
    missed: u64,
    open: u64,
    /// The numbers may have started again since the last image.
    may_restart: bool,
}

impl ImageNumbering {
    /// Returns whether an image was observed.
    pub(crate) fn has_image(&self) -> bool {
        self.tracker.last().is_some()
    }

    /// An exchange without a known result. `may_publish`: the gateway may be in SAFEOP or OP.
    #[inline]
    pub(crate) fn missed(&mut self, may_publish: impl FnOnce() -> bool) {
        self.missed = self.missed.saturating_add(1);
        if self.missed <= ALWAYS_POSSIBLE || may_publish() {
            self.open = self.open.saturating_add(1);
        }
    }

    /// The numbers may start again from here on, until the next image.
    #[inline]
    pub(crate) fn allow_restart(&mut self) {
        self.may_restart = true;
    }

    /// A valid image; `None` if it is the last one again.
    #[inline]
    pub(crate) fn observe(&mut self, sequence: u16) -> Option<MissingImages> {
        let is_first = !self.has_image();
        let arrival = self.tracker.observe(sequence);
        if arrival == Arrival::Repeated {
            return None;
        }
        let (missed, open) = (std::mem::take(&mut self.missed), std::mem::take(&mut self.open));
        let may_restart = std::mem::take(&mut self.may_restart);
        let lost = match arrival {
            _ if is_first => return Some(MissingImages::default()),
            Arrival::Gap { lost } => Some(lost),
            Arrival::Repeated | Arrival::Next => Some(0),
            Arrival::First => None,
        };
        // The image in the buffer is dropped when the gateway leaves SAFEOP.
        let most = missed + u64::from(missed > 0);
        let restarts = may_restart && u64::from(sequence) <= most + 1 && missed > 0;
        let is_exact = |lost: &u16| !may_restart || (!restarts && u64::from(*lost) <= most);
        Some(match lost.filter(is_exact) {
            Some(lost) => MissingImages { lost, unknown: 0 },
            None => {
                let since_restart = u64::from(sequence).saturating_sub(1).min(most);
                let unknown = open + u64::from(open > 0) + since_restart;
                MissingImages { lost: 0, unknown }
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: MissingImages = MissingImages { lost: 0, unknown: 0 };

    fn after(sequence: u16, missed: u64, may_restart: bool) -> ImageNumbering {
        let mut numbering = ImageNumbering::default();
        assert_eq!(numbering.observe(sequence), Some(KNOWN));
        (0..missed).for_each(|_| numbering.missed(|| false));
        if may_restart {
            numbering.allow_restart();
        }
        numbering
    }

    fn unknown(unknown: u64) -> Option<MissingImages> {
        Some(MissingImages { lost: 0, unknown })
    }

    fn lost(lost: u16) -> Option<MissingImages> {
        Some(MissingImages { lost, unknown: 0 })
    }

    #[test]
    fn gap_in_a_session_is_exact() {
        let mut numbering = after(7, 3, false);
        assert_eq!(numbering.observe(7), None);
        assert_eq!(numbering.observe(10), lost(2));
        assert_eq!(numbering.observe(11), Some(KNOWN));
    }

    #[test]
    fn numbers_that_continue_over_an_outage_are_exact() {
        assert_eq!(after(500, 20, true).observe(505), lost(4));
        assert_eq!(
            after(500, 200, true).observe(650),
            lost(149),
            "the state in the master does not count"
        );
    }

    #[test]
    fn gap_over_the_wrap_is_exact() {
        assert_eq!(after(0xFFFE, 0, false).observe(0xFFFF), Some(KNOWN));
        assert_eq!(after(0xFFFF, 0, false).observe(0), Some(KNOWN));
        assert_eq!(after(0xFFFF, 0, false).observe(0xFFFF), None);
        assert_eq!(after(0xFFFD, 3, false).observe(1), lost(3));
        assert_eq!(after(0xFFF8, 20, true).observe(4), unknown(24), "either is possible");
    }

    #[test]
    fn numbers_that_start_again_leave_unknown_images() {
        assert_eq!(after(500, 20, true).observe(1), unknown(21), "step back");
        assert_eq!(after(3, 20, true).observe(5), unknown(25), "either is possible");
        assert_eq!(after(500, 20, true).observe(900), unknown(42), "too large a gap");
        assert_eq!(after(500, 200, true).observe(1), unknown(33), "the slave was absent");
        assert_eq!(after(500, 0, true).observe(1), Some(KNOWN), "every exchange is known");
        assert_eq!(after(500, 0, true).observe(501), Some(KNOWN));
    }
}
