//! Distance of two raw positions of a counter that may wrap.

/// Range of the position counter of a drive.
///
/// Every comparison of positions (step limit, following-error window, standstill) goes through
/// [`distance`](Self::distance), every addition through [`add`](Self::add), so that a wrap is
/// never taken for a jump nor a jump for a wrap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PositionRange {
    /// The counter ends at the limits of an `i32`. Nothing may be commanded beyond them, and
    /// -2147483648 is as far from 2147483647 as it looks.
    #[default]
    Linear,
    /// The counter wraps over the whole `i32`: one step beyond 2147483647 is -2147483648.
    Wrapping,
    /// The counter wraps within 0x607B (position range limit): one step beyond `max` is `min`.
    Modulo {
        /// Smallest position, 0x607B:01.
        min: i32,
        /// Largest position, 0x607B:02; above `min`.
        max: i32,
    },
}

impl PositionRange {
    /// Signed distance from one position to another, in steps: the shorter one if the counter
    /// wraps. Real-time safe.
    pub fn distance(self, from: i32, to: i32) -> i64 {
        match self {
            Self::Linear => i64::from(to) - i64::from(from),
            Self::Wrapping => i64::from(to.wrapping_sub(from)),
            Self::Modulo { min, max } => {
                let span = span(min, max);
                let steps = (i64::from(to) - i64::from(from)).rem_euclid(span);
                if steps * 2 >= span { steps - span } else { steps }
            }
        }
    }

    /// The position at a distance of `steps` from `from`; `None` if a linear counter ends before. Real-time safe.
    pub fn add(self, from: i32, steps: i64) -> Option<i32> {
        match self {
            Self::Linear => i32::try_from(i64::from(from).checked_add(steps)?).ok(),
            // The cast keeps the low 32 bits: that is the wrap.
            Self::Wrapping => Some(i64::from(from).wrapping_add(steps) as i32),
            Self::Modulo { min, max } => {
                let offset = i64::from(from).checked_sub(i64::from(min))?.checked_add(steps)?;
                i32::try_from(i64::from(min) + offset.rem_euclid(span(min, max))).ok()
            }
        }
    }

    /// Returns whether the counter can stand there. Real-time safe.
    pub fn contains(self, position: i32) -> bool {
        match self {
            Self::Linear | Self::Wrapping => true,
            Self::Modulo { min, max } => (min..=max).contains(&position),
        }
    }
}

/// Positions of a modulo counter; at least one, so that it can divide.
fn span(min: i32, max: i32) -> i64 {
    (i64::from(max) - i64::from(min) + 1).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TURN: PositionRange = PositionRange::Modulo { min: 0, max: 3599 };

    #[test]
    fn linear_counter_ends_at_its_limits() {
        assert_eq!(PositionRange::Linear.distance(i32::MAX, i32::MIN), -0xFFFF_FFFF);
        assert_eq!(PositionRange::Linear.add(i32::MAX, 1), None);
        assert_eq!(PositionRange::Linear.add(i32::MIN, -1), None);
        assert_eq!(PositionRange::Linear.add(-5, 10), Some(5));
    }

    #[test]
    fn wrapping_counter_continues() {
        assert_eq!(PositionRange::Wrapping.distance(i32::MAX, i32::MIN), 1);
        assert_eq!(PositionRange::Wrapping.distance(i32::MIN, i32::MAX), -1);
        assert_eq!(PositionRange::Wrapping.add(i32::MAX, 1), Some(i32::MIN));
        assert_eq!(PositionRange::Wrapping.add(i32::MIN, -1), Some(i32::MAX));
    }

    #[test]
    fn modulo_counter_uses_the_shorter_distance() {
        assert_eq!(TURN.distance(3590, 10), 20);
        assert_eq!(TURN.distance(10, 3590), -20);
        assert_eq!(TURN.distance(0, 1799), 1799);
        assert_eq!(TURN.distance(0, 1800), -1800);
        assert_eq!(TURN.add(3590, 20), Some(10));
        assert_eq!(TURN.add(10, -20), Some(3590));
        assert!(TURN.contains(3599) && !TURN.contains(3600) && !TURN.contains(-1));
    }

    #[test]
    fn empty_modulo_range_does_not_divide_by_zero() {
        let range = PositionRange::Modulo { min: 5, max: -5 };
        assert_eq!(range.distance(1, 9), 0);
        assert_eq!(range.add(5, 7), Some(5));
    }

    fn any_range() -> impl Strategy<Value = PositionRange> {
        prop_oneof![
            Just(PositionRange::Linear),
            Just(PositionRange::Wrapping),
            (any::<i32>(), any::<i32>())
                .prop_map(|(a, b)| PositionRange::Modulo { min: a.min(b), max: a.max(b) }),
        ]
    }

    proptest! {
        #[test]
        fn adding_the_distance_reaches_the_target(range in any_range(), from: i32, to: i32) {
            prop_assume!(range.contains(from) && range.contains(to));
            let steps = range.distance(from, to);
            prop_assert_eq!(range.add(from, steps), Some(to));
        }

        #[test]
        fn adding_stays_in_the_range(range in any_range(), from: i32, steps: i64) {
            if let Some(to) = range.add(from, steps) {
                prop_assert!(range.contains(to) || !range.contains(from));
            }
        }
    }
}
