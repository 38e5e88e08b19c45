//! Detection of standstill from actual positions.

use crate::guard::position_range::PositionRange;

/// Time for which the position must not leave the standstill window.
pub(crate) const REST_NS: u64 = 20_000_000;

/// Fewest positions in that time.
const SAMPLES: u16 = 3;

/// Most of that time that one position counts for: a host that was paused gets positions from before.
const MOST_NS: u64 = REST_NS / 2;

/// Detects that an axis is at rest: all positions of a time are within the standstill window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct RestDetector {
    anchor: Option<i32>,
    rest_ns: u64,
    last_ns: u64,
    samples: u16,
}

impl RestDetector {
    pub(crate) fn observe(
        &mut self,
        position: i32,
        range: PositionRange,
        standstill: u32,
        now_ns: u64,
    ) {
        let is_near = self.anchor.is_some_and(|anchor| {
            range.distance(anchor, position).unsigned_abs() <= u64::from(standstill)
        });
        if is_near {
            self.samples = self.samples.saturating_add(1);
            let passed_ns = now_ns.saturating_sub(self.last_ns).min(MOST_NS);
            self.rest_ns = self.rest_ns.saturating_add(passed_ns);
        } else {
            *self = Self { anchor: Some(position), rest_ns: 0, last_ns: now_ns, samples: 1 };
        }
        self.last_ns = now_ns;
    }

    /// Starts over: earlier positions no longer count.
    pub(crate) fn restart(&mut self) {
        *self = Self::default();
    }

    pub(crate) fn position(&self) -> Option<i32> {
        self.anchor
    }

    /// Returns whether the last positions showed standstill, however old.
    pub(crate) fn was_at_rest(&self) -> bool {
        self.is_at_rest(self.last_ns, 0)
    }

    /// Returns whether no position was observed.
    pub(crate) fn is_empty(&self) -> bool {
        self.samples == 0
    }

    /// Returns whether the positions up to now show standstill; the last one must not be older than
    /// `longest_ns`.
    pub(crate) fn is_at_rest(&self, now_ns: u64, longest_ns: u64) -> bool {
        self.samples >= SAMPLES
            && self.rest_ns >= REST_NS
            && now_ns.saturating_sub(self.last_ns) <= longest_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const LONGEST_NS: u64 = 100 * MS;

    /// Observes positions and returns whether the last one completes a standstill.
    fn observe(detector: &mut RestDetector, positions: &[i32], from_ms: u64, step_ms: u64) -> bool {
        let mut is_at_rest = false;
        for (nth, position) in (0_u64..).zip(positions) {
            let now_ns = (from_ms + nth * step_ms) * MS;
            detector.observe(*position, PositionRange::Linear, 20, now_ns);
            is_at_rest = detector.is_at_rest(now_ns, LONGEST_NS);
        }
        is_at_rest
    }

    #[test]
    fn noise_is_rest_after_its_time() {
        let mut detector = RestDetector::default();
        assert!(!observe(&mut detector, &[0, 5, -5, 9, -9], 0, 4), "16 ms");
        assert!(observe(&mut detector, &[3], 20, 4));
        assert!(!detector.is_at_rest(20 * MS + LONGEST_NS + 1, LONGEST_NS), "too old");
    }

    #[test]
    fn slow_motion_is_not_rest() {
        let mut detector = RestDetector::default();
        for nth in 0..200 {
            assert!(!observe(&mut detector, &[nth * 5], nth as u64, 1), "{nth} ms");
        }
    }

    #[test]
    fn positions_from_before_a_pause_are_not_rest() {
        let mut detector = RestDetector::default();
        assert!(!observe(&mut detector, &[0, 5, 10], 0, 1));
        assert!(!observe(&mut detector, &[15, 20], 200, 1), "one from before, one from after");
        assert!(observe(&mut detector, &[20; 9], 202, 1));
    }

    #[test]
    fn few_positions_are_not_rest() {
        let mut detector = RestDetector::default();
        assert!(!observe(&mut detector, &[0, 0], 0, 90));
        assert!(observe(&mut detector, &[0], 180, 1));
        detector.restart();
        assert!(!detector.is_at_rest(180 * MS, LONGEST_NS));
    }
}
