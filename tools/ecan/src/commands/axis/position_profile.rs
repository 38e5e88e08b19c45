//! Trapezoidal motion of a position target.

/// A target position that moves with limited velocity and acceleration, in steps and seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionProfile {
    position: f64,
    velocity: f64,
}

/// Limits of a profile: velocity in steps/s, acceleration in steps/s^2, both above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProfileLimits {
    pub velocity: f64,
    pub acceleration: f64,
}

impl PositionProfile {
    /// A profile at rest.
    pub fn at_rest(position: f64) -> Self {
        Self { position, velocity: 0.0 }
    }

    pub fn position(&self) -> f64 {
        self.position
    }

    /// The profile after a period of motion toward a goal: it accelerates, keeps the velocity limit, and
    /// comes to rest at the goal without passing it. The deceleration of the last period is at most an
    /// eighth above the limit, so that the motion ends at the goal.
    #[must_use]
    pub fn toward(&self, goal: f64, limits: ProfileLimits, seconds: f64) -> Self {
        let ProfileLimits { velocity: most, acceleration } = limits;
        let distance = goal - self.position;
        let change = acceleration * seconds;
        // The largest velocity from which whole periods of deceleration end at the goal.
        let half = change / 2.0;
        let allowed = (half * half + 2.0 * acceleration * distance.abs()).sqrt() - half;
        let wanted = allowed.clamp(0.0, most).copysign(distance);
        let velocity = wanted.clamp(self.velocity - change, self.velocity + change);
        let step = velocity * seconds;
        let is_there = distance.abs() <= change * seconds && velocity.abs() <= change;
        match is_there || (step.abs() > distance.abs() && step.signum() == distance.signum()) {
            true => Self { position: goal, velocity: 0.0 },
            false => Self { position: self.position + step, velocity },
        }
    }

    /// Returns whether the profile is at rest at a goal.
    pub fn is_at(&self, goal: f64) -> bool {
        self.position == goal && self.velocity == 0.0
    }

    /// The profile at rest at its position, after an interruption.
    #[must_use]
    pub fn interrupted(&self) -> Self {
        Self::at_rest(self.position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PERIOD: f64 = 0.001;

    fn run(start: f64, goal: f64, limits: ProfileLimits) -> Vec<PositionProfile> {
        let mut profile = PositionProfile::at_rest(start);
        let mut profiles = vec![profile];
        while !profile.is_at(goal) {
            profile = profile.toward(goal, limits, PERIOD);
            profiles.push(profile);
            assert!(profiles.len() < 2_000_000, "it does not end: {profile:?}");
        }
        profiles
    }

    #[test]
    fn trapezoid_has_the_duration_of_its_limits() {
        let limits = ProfileLimits { velocity: 1_000.0, acceleration: 2_000.0 };
        let profiles = run(0.0, 2_000.0, limits);
        // 2 s at the limit, and half a second for both ramps.
        let seconds = profiles.len() as f64 * PERIOD;
        assert!((2.49..2.53).contains(&seconds), "{seconds}");
        let most = profiles.iter().map(|it| it.velocity).fold(0.0, f64::max);
        assert_eq!(most, 1_000.0);
    }

    proptest! {
        #[test]
        fn profile_keeps_its_limits_and_ends_at_the_goal(
            start in -1e5..1e5_f64,
            goal in -1e5..1e5_f64,
            velocity in 1e3..1e6_f64,
            ramp in 0.01..2.0_f64,
        ) {
            let limits = ProfileLimits { velocity, acceleration: velocity / ramp };
            let profiles = run(start, goal, limits);
            let change = limits.acceleration * PERIOD;
            let positions: Vec<_> = profiles.iter().map(PositionProfile::position).collect();
            let between = (start.min(goal) - 1e-6)..=(start.max(goal) + 1e-6);
            prop_assert!(positions.iter().all(|position| between.contains(position)));
            // At rest before and after.
            let mut velocities = vec![0.0];
            velocities.extend(positions.windows(2).map(|pair| (pair[1] - pair[0]) / PERIOD));
            velocities.push(0.0);
            prop_assert!(velocities.iter().all(|it| it.abs() <= velocity * 1.000_001));
            // The last period before rest has an eighth more: it ends at the goal, not near it.
            let most = velocities.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
            prop_assert!(most <= change * 1.126, "{most} {change}");
        }
    }
}
