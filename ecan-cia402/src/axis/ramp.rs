//! Motion that the host makes itself: a step per target, limited in its change and in the change of
//! its change.

/// Binary places of the fixed-point numbers in a [`Ramp`]: an increment is 2^32 units.
pub(crate) const FRACTION_BITS: u32 = 32;

/// More cycles than any ramp takes: a change that would need them to end is not reached.
const MOST_CYCLES: i128 = 1 << 40;

/// Limits of a [`Profile`], in units per cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RampLimits {
    /// Largest change of the rate per cycle; at least 1.
    change: i128,
    /// Largest change of that change per cycle; 0 is no limit.
    jerk: i128,
    /// Change of the rate while the largest change ends by the jerk.
    ending: i128,
}

impl RampLimits {
    /// Limits in units; a change of 0 counts as 1.
    pub(crate) fn new(change: i128, jerk: i128) -> Self {
        let change = change.max(1);
        let ending = match jerk {
            0 => change,
            jerk => {
                let cycles = change.div_euclid(jerk) + i128::from(change % jerk != 0);
                let ends = cycles <= MOST_CYCLES;
                if ends { ending(change, jerk, cycles) } else { i128::MAX }
            }
        };
        Self { change, jerk, ending }
    }

    /// A change in whole increments, without a limit of the jerk; 0 counts as 1.
    pub(crate) fn increments(change: u32) -> Self {
        Self::new(i128::from(change.max(1)) << FRACTION_BITS, 0)
    }

    /// Returns these limits with another jerk, in units.
    pub(crate) fn with_jerk(self, jerk: i128) -> Self {
        Self::new(self.change, jerk)
    }

    pub(crate) fn change(&self) -> i128 {
        self.change
    }

    pub(crate) fn jerk(&self) -> i128 {
        self.jerk
    }

    /// Largest change in the next cycle from which the rate, if the change then falls to 0 by the
    /// jerk, moves by at most `room`.
    fn reach(&self, room: i128) -> i128 {
        if room <= 0 {
            return 0;
        }
        if self.jerk == 0 || room >= self.ending {
            return self.change.min(room);
        }
        // The least number of cycles n with jerk * n (n + 1) / 2 >= room.
        let levels = room / self.jerk + i128::from(room % self.jerk != 0);
        let whole = ((8 * levels + 1).isqrt() - 1) / 2;
        let cycles = if whole * (whole + 1) / 2 < levels { whole + 1 } else { whole };
        let change = (room + self.jerk * (cycles * (cycles - 1) / 2)) / cycles;
        change.min(self.change)
    }
}

/// Sum of `change`, `change - jerk`, ... over `cycles`.
fn ending(change: i128, jerk: i128, cycles: i128) -> i128 {
    cycles * change - jerk * (cycles * (cycles - 1) / 2)
}

/// A rate that approaches another one, in units of any fixed-point number. Integers only: no drift,
/// and the same on every machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Profile {
    pub(crate) rate: i128,
    /// Change of the rate in the last cycle.
    pub(crate) change: i128,
}

impl Profile {
    /// The profile one cycle further on the way to `goal`.
    ///
    /// Change and jerk stay inside their limits, the rate never passes the goal, and its amount
    /// does not exceed `most` (or, if it does already, does not grow). The limits of goal and `most`
    /// have precedence over the jerk, which they exceed only in the first cycle after a start
    /// with a change that no jerk inside the limit could take back in time.
    pub(crate) fn next(self, goal: i128, most: i128, limits: &RampLimits) -> Self {
        let distance = goal - self.rate;
        let change = if limits.jerk == 0 {
            distance.clamp(-limits.change, limits.change)
        } else {
            let above = if distance >= 0 { distance } else { most - self.rate };
            let below = if distance <= 0 { -distance } else { most + self.rate };
            let wanted = self.change + limits.jerk * distance.signum();
            wanted.clamp(-limits.reach(below), limits.reach(above))
        };
        Self { rate: self.rate + change, change }
    }
}

/// Motion of an axis by a [`Profile`]: a step per target.
///
/// Drives [`send_target_step`](crate::Cia402::send_target_step), halt and shutdown. The steps are
/// those of the profile's position, rounded to the nearest increment: an axis is never further than
/// half an increment from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Ramp {
    /// Rate in units per target.
    profile: Profile,
    /// Distance of the profile's position from the target, plus half an increment, in units.
    fraction: i128,
    step: i64,
}

impl Default for Ramp {
    /// At rest.
    fn default() -> Self {
        Self::following(0, 0)
    }
}

impl Ramp {
    /// Continues a motion of the application: its last step and its change of the step, in units.
    pub(crate) fn following(rate: i128, change: i128) -> Self {
        Self { profile: Profile { rate, change }, fraction: 1 << (FRACTION_BITS - 1), step: 0 }
    }

    /// The ramp one target further on the way to a step of `goal`, with steps of at most `most`.
    pub(crate) fn next(&self, goal: i64, most: u32, limits: &RampLimits) -> Self {
        let goal = i128::from(goal) << FRACTION_BITS;
        let profile = self.profile.next(goal, i128::from(most) << FRACTION_BITS, limits);
        self.moved(profile)
    }

    /// The ramp one target further, by a profile that is made elsewhere.
    pub(crate) fn moved(&self, profile: Profile) -> Self {
        let position = self.fraction + profile.rate;
        let step = i64::try_from(position >> FRACTION_BITS).unwrap_or(i64::MAX);
        let fraction = position & ((1 << FRACTION_BITS) - 1);
        Self { profile, fraction, step }
    }

    /// The step that led here.
    pub(crate) fn step(&self) -> i64 {
        self.step
    }

    pub(crate) fn profile(&self) -> Profile {
        self.profile
    }

    /// The rate, rounded to the nearest increment.
    pub(crate) fn rounded_rate(&self) -> i64 {
        let half = 1 << (FRACTION_BITS - 1);
        i64::try_from((self.profile.rate + half) >> FRACTION_BITS).unwrap_or(i64::MAX)
    }

    pub(crate) fn is_at_rest(&self) -> bool {
        self.profile.rate == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ONE: i128 = 1 << FRACTION_BITS;

    fn limits(change: f64, jerk: f64) -> RampLimits {
        let units = |value: f64| (value * ONE as f64) as i128;
        RampLimits::new(units(change), units(jerk))
    }

    fn run(ramp: &mut Ramp, goal: i64, cycles: usize, limits: &RampLimits) -> Vec<i64> {
        (0..cycles)
            .map(|_| {
                *ramp = ramp.next(goal, u32::MAX, limits);
                ramp.step()
            })
            .collect()
    }

    /// The profile of a motion until it is at its goal, the start first.
    fn course(start: Profile, goal: i128, most: i128, limits: &RampLimits) -> Vec<Profile> {
        let mut course = vec![start];
        while let Some(last) = course.last()
            && (last.rate, last.change) != (goal, 0)
        {
            let next = last.next(goal, most, limits);
            course.push(next);
            assert!(course.len() < 100_000, "{start:?} to {goal}: {next:?}");
        }
        course
    }

    #[test]
    fn reach_is_the_largest_change_that_ends_inside_the_room() {
        for (change, jerk) in (1..=12).flat_map(|change| (0..=7).map(move |jerk| (change, jerk))) {
            let limits = RampLimits::new(change, jerk);
            let moved = |first: i128| match jerk {
                0 => first,
                jerk => (0..first).map(|nth| (first - nth * jerk).max(0)).sum(),
            };
            for room in -2..=90 {
                let largest = (0..=change).rev().find(|first| moved(*first) <= room.max(0));
                assert_eq!(Some(limits.reach(room)), largest, "{limits:?} {room}");
            }
        }
    }

    #[test]
    fn ramp_without_jerk_rises_and_falls_by_its_change() {
        let (mut ramp, limits) = (Ramp::default(), RampLimits::increments(30));
        assert_eq!(run(&mut ramp, 100, 5, &limits), [30, 60, 90, 100, 100]);
        assert_eq!(run(&mut ramp, 0, 5, &limits), [70, 40, 10, 0, 0]);
        assert_eq!(run(&mut ramp, -40, 3, &limits), [-30, -40, -40]);
        assert!(!ramp.is_at_rest());
    }

    #[test]
    fn ramp_with_jerk_rounds_both_ends() {
        let (mut ramp, limits) = (Ramp::default(), limits(30.0, 10.0));
        assert_eq!(run(&mut ramp, 100, 7, &limits), [10, 30, 60, 83, 97, 100, 100]);
        assert_eq!(run(&mut ramp, 0, 7, &limits), [90, 70, 40, 17, 3, 0, 0]);
        assert!(ramp.is_at_rest());
    }

    #[test]
    fn jerk_below_an_increment_is_effective() {
        let (mut ramp, limits) = (Ramp::default(), limits(0.05, 0.001));
        let steps = run(&mut ramp, 3, 200, &limits);
        // 50 cycles to the full change, 9 at it, 50 back: half the rate on average.
        assert_eq!(steps.iter().sum::<i64>(), 110 * 3 / 2 + 91 * 3);
        assert!(steps.is_sorted_by(|before, after| after - before >= -1), "{steps:?}");
    }

    #[test]
    fn ramp_survives_any_number() {
        for jerk in [0, 1, ONE, i128::from(u32::MAX) << FRACTION_BITS] {
            let limits = RampLimits::new(i128::from(u32::MAX) << FRACTION_BITS, jerk);
            for rate in [i64::MIN, -1, 0, 1, i64::MAX] {
                let ramp = Ramp::following(i128::from(rate) << FRACTION_BITS, 0);
                for goal in [i64::MIN, 0, i64::MAX] {
                    let next = ramp.next(goal, u32::MAX, &limits).profile();
                    assert!(next.rate <= ramp.profile().rate.max(i128::from(goal) << 32));
                    assert!(next.rate >= ramp.profile().rate.min(i128::from(goal) << 32));
                }
            }
        }
    }

    #[test]
    fn change_too_large_for_the_jerk_is_cut_without_a_reversal() {
        // 100 per cycle down from 150: a jerk of 1 would end it at -4850.
        let limits = limits(100.0, 1.0);
        let start = Profile { rate: 150 * ONE, change: -100 * ONE };
        let course = course(start, 0, 1_000 * ONE, &limits);
        let second = course.get(1).map(|profile| profile.change / ONE);
        assert_eq!(second, Some(-16), "a jerk of 1 ends it at 0");
        assert!(course.iter().all(|profile| profile.rate >= 0), "{course:?}");
    }

    fn any_limits() -> impl Strategy<Value = RampLimits> {
        (1_i128..1 << 40, 0_u32..12)
            .prop_map(|(change, shift)| RampLimits::new(change, (change >> shift).max(1)))
    }

    proptest! {
        /// Rates in increments up to a million, from every change that the limits allow.
        #[test]
        fn allowed_start_keeps_all_limits(
            limits in any_limits(), rate in -1.0_f64..1.0, goal in -1.0_f64..1.0,
            change in -1.0_f64..1.0, stop: bool,
        ) {
            // At most some 10,000 cycles.
            let most = (limits.change * 1_000).min(1_000_000 * ONE);
            let rate = (rate * most as f64) as i128;
            let goal = if stop { 0 } else { (goal * most as f64) as i128 };
            let (above, below) = if goal >= rate {
                (goal - rate, rate + most)
            } else {
                (most - rate, rate - goal)
            };
            let (above, below) = (limits.reach(above), limits.reach(below));
            let change = ((change * limits.change as f64) as i128).clamp(-below, above);
            let course = course(Profile { rate, change }, goal, most, &limits);
            for pair in course.windows(2) {
                let [before, after] = pair else { unreachable!() };
                prop_assert_eq!(after.rate - before.rate, after.change);
                prop_assert!(after.change.abs() <= limits.change);
                prop_assert!((after.change - before.change).abs() <= limits.jerk, "{:?}", pair);
                prop_assert!(after.rate.abs() <= most);
                prop_assert!((before.rate >= goal) == (after.rate >= goal) || after.rate == goal);
            }
        }

        /// Of a start beyond the limits only the first cycle exceeds them.
        #[test]
        fn any_start_ends_without_passing_its_goal(
            limits in any_limits(), rate in -1.0_f64..1.0, change in -100.0_f64..100.0,
        ) {
            let most = (limits.change * 1_000).min(1_000_000 * ONE);
            let rate = (rate * most as f64) as i128;
            let change = (change * limits.change as f64) as i128;
            let course = course(Profile { rate, change }, 0, most, &limits);
            for (nth, pair) in course.windows(2).enumerate() {
                let [before, after] = pair else { unreachable!() };
                prop_assert!(after.change.abs() <= limits.change);
                prop_assert!(nth == 0 || (after.change - before.change).abs() <= limits.jerk);
                prop_assert!(after.rate.abs() <= most);
                prop_assert!(after.rate == 0 || (after.rate > 0) == (rate > 0), "no reversal");
            }
        }

        #[test]
        fn stop_ends_in_bounded_time(limits in any_limits(), rate in 0.0_f64..1.0) {
            let rate = (rate * (limits.change * 1_000).min(1_000_000 * ONE) as f64) as i128;
            let course = course(Profile { rate, change: 0 }, 0, rate, &limits);
            // Twice the time to reach the change, and the time at it, or, if it is not reached,
            // twice the root of rate over jerk.
            let (rate, change, jerk) = (rate as f64, limits.change as f64, limits.jerk as f64);
            let bound = rate / change + 2.0 * (change / jerk).min((2.0 * rate / jerk).sqrt());
            prop_assert!((course.len() as f64) <= bound + 4.0, "{} {bound}", course.len());
        }

        #[test]
        fn steps_follow_the_profile_within_half_an_increment(
            limits in any_limits(), rate in -1_000_000_i64..1_000_000,
        ) {
            let mut ramp = Ramp::following(i128::from(rate) << FRACTION_BITS, 0);
            let (mut position, mut exact) = (0_i128, 0_i128);
            for _ in 0..1_000 {
                ramp = ramp.next(0, 1_000_000, &limits);
                position += i128::from(ramp.step()) << FRACTION_BITS;
                exact += ramp.profile().rate;
                prop_assert!((position - exact).abs() <= ONE / 2);
            }
        }
    }
}
