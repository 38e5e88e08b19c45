//! Limits of the feed-forward of an axis.

/// Feed-forward of one target, added by the drive to the demand of its controllers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FeedForward {
    /// Velocity offset 0x60B1, in units of the drive's velocity.
    pub velocity: i32,
    /// Torque offset 0x60B2, in thousandths of the rated torque.
    pub torque: i16,
}

impl FeedForward {
    /// No feed-forward.
    pub const NONE: Self = Self { velocity: 0, torque: 0 };
}

/// Limits of the feed-forward. Values are of both directions; one that is 0 allows none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FeedForwardLimits {
    /// Largest velocity offset, in units of the drive's velocity. If the scale has
    /// [velocity units](crate::Scale::with_velocity_units), the velocity limit of the axis applies,
    /// too.
    pub velocity: u32,
    /// Largest change of the velocity offset per target period.
    pub velocity_change: u32,
    /// Largest torque offset, in thousandths of the rated torque.
    pub torque: u16,
    /// Largest change of the torque offset per target period.
    pub torque_change: u16,
}

/// Keeps the feed-forward of an axis within its limits. A pure state machine: it never passes a
/// value beyond the limits, nor one that differs from the last by more than the change, except for
/// the return to 0 when the targets end.
///
/// A feed-forward belongs to one target. If a target has none, the offsets return to 0 by the
/// change. Real-time safe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FeedForwardGuard {
    limits: FeedForwardLimits,
    last: FeedForward,
}

impl FeedForwardGuard {
    /// Creates a guard without a feed-forward in force.
    pub fn new(limits: FeedForwardLimits) -> Self {
        Self { limits, last: FeedForward::NONE }
    }

    /// The feed-forward in force.
    pub fn last(&self) -> FeedForward {
        self.last
    }

    /// Takes the feed-forward of the target that is sent, `None` for a target without one. Returns
    /// whether a limit changed it.
    pub fn follow(&mut self, requested: Option<FeedForward>) -> bool {
        let FeedForwardLimits { velocity, velocity_change, torque, torque_change } = self.limits;
        let wanted = requested.unwrap_or_default();
        let next = FeedForward {
            velocity: limited(self.last.velocity, wanted.velocity, velocity, velocity_change),
            // infallible: inside the limits of an i16
            torque: limited(
                self.last.torque.into(),
                wanted.torque.into(),
                u32::from(torque).min(i16::MAX as u32),
                torque_change.into(),
            ) as i16,
        };
        self.last = next;
        requested.is_some_and(|requested| requested != next)
    }

    /// Ends the feed-forward at once: the axis gets no targets any more.
    pub fn end(&mut self) {
        self.last = FeedForward::NONE;
    }
}

/// The value after `last` in the direction of `wanted`: at most `change` further, within `most`.
fn limited(last: i32, wanted: i32, most: u32, change: u32) -> i32 {
    let most = i64::from(most.min(i32::MAX as u32));
    let wanted = i64::from(wanted).clamp(-most, most);
    let (last, change) = (i64::from(last), i64::from(change));
    // infallible: between two values of an i32
    wanted.clamp(last - change, last + change).clamp(i32::MIN.into(), i32::MAX.into()) as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: FeedForwardLimits =
        FeedForwardLimits { velocity: 1_000, velocity_change: 300, torque: 50, torque_change: 20 };

    fn forward(velocity: i32, torque: i16) -> Option<FeedForward> {
        Some(FeedForward { velocity, torque })
    }

    #[test]
    fn feed_forward_rises_by_its_change_and_stays_in_its_limits() {
        let mut guard = FeedForwardGuard::new(LIMITS);
        let mut seen = Vec::new();
        for _ in 0..5 {
            assert!(guard.follow(forward(i32::MAX, i16::MIN)));
            seen.push((guard.last().velocity, guard.last().torque));
        }
        assert_eq!(seen, [(300, -20), (600, -40), (900, -50), (1_000, -50), (1_000, -50)]);
        assert!(!guard.follow(forward(990, -45)), "within the limits");
        assert!(!guard.follow(None), "nothing was requested");
        assert_eq!(guard.last(), FeedForward { velocity: 690, torque: -25 });
        guard.end();
        assert_eq!(guard.last(), FeedForward::NONE);
    }

    #[test]
    fn limits_of_zero_allow_no_feed_forward() {
        let mut guard = FeedForwardGuard::new(FeedForwardLimits::default());
        assert!(guard.follow(forward(1, 1)));
        assert_eq!(guard.last(), FeedForward::NONE);
    }

    proptest! {
        #[test]
        fn no_sequence_exceeds_the_limits(
            velocity: u32, velocity_change: u32, torque: u16, torque_change: u16,
            wanted in prop::collection::vec(prop::option::of((any::<i32>(), any::<i16>())), 1..60),
            ends in prop::collection::vec(prop::bool::weighted(0.1), 60),
        ) {
            let limits =
                FeedForwardLimits { velocity, velocity_change, torque, torque_change };
            let mut guard = FeedForwardGuard::new(limits);
            for (wanted, ends) in wanted.into_iter().zip(ends) {
                let before = guard.last();
                if ends {
                    guard.end();
                    prop_assert_eq!(guard.last(), FeedForward::NONE);
                    continue;
                }
                let is_cut = guard.follow(wanted.map(|(velocity, torque)| FeedForward { velocity, torque }));
                let after = guard.last();
                prop_assert!(after.velocity.unsigned_abs() <= velocity);
                prop_assert!(after.torque.unsigned_abs() <= torque);
                prop_assert!(after.velocity.abs_diff(before.velocity) <= velocity_change);
                prop_assert!(after.torque.abs_diff(before.torque) <= torque_change);
                let (rate, force) = wanted.unwrap_or_default();
                prop_assert_eq!(is_cut, wanted.is_some() && (rate, force) != (after.velocity, after.torque));
                // Never beyond the request, nor against it.
                let (low, high) = (before.velocity.min(rate), before.velocity.max(rate));
                prop_assert!((low..=high).contains(&after.velocity));
            }
        }
    }
}
