//! A demand that moves with limited velocity and acceleration.

/// Limits of a motion; positive, in increments and seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounds {
    pub(super) velocity: f64,
    pub(super) acceleration: f64,
    pub(super) deceleration: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Ramp {
    pub(super) position: f64,
    pub(super) velocity: f64,
}

impl Ramp {
    pub(super) const fn at(position: f64) -> Self {
        Self { position, velocity: 0.0 }
    }

    pub(super) fn towards_velocity(&mut self, seconds: f64, velocity: f64, bounds: &Bounds) {
        let before = self.velocity;
        let demand = velocity.clamp(-bounds.velocity, bounds.velocity);
        self.velocity = approach(before, demand, seconds, bounds);
        self.position += (before + self.velocity) / 2.0 * seconds;
    }

    /// Advances one step towards a position, to arrive there at rest. Returns true on arrival.
    pub(super) fn towards_position(&mut self, seconds: f64, target: f64, bounds: &Bounds) -> bool {
        let distance = target - self.position;
        let half = bounds.deceleration * seconds / 2.0;
        let nears = self.velocity * distance.signum();
        // The velocity after this step from which the remaining distance suffices to brake.
        let rest = distance.abs() - nears * seconds / 2.0;
        let bound = (half * half + 2.0 * bounds.deceleration * rest).max(0.0).sqrt() - half;
        let demand = bound.clamp(0.0, bounds.velocity).copysign(distance);
        // One more step of braking ends at the target.
        let near = distance.abs() <= (nears.abs() + 2.0 * half) * seconds;
        if near && nears.abs() <= 2.0 * half {
            *self = Self::at(target);
            return true;
        }
        let before = self.velocity;
        self.velocity = approach(before, demand, seconds, bounds);
        self.position += (before + self.velocity) / 2.0 * seconds;
        false
    }
}

fn approach(velocity: f64, demand: f64, seconds: f64, bounds: &Bounds) -> f64 {
    let speeds_up = demand.abs() > velocity.abs() && demand * velocity >= 0.0;
    let rate = if speeds_up { bounds.acceleration } else { bounds.deceleration };
    let change = rate * seconds;
    if (demand - velocity).abs() <= change {
        demand
    } else {
        velocity + change.copysign(demand - velocity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: Bounds =
        Bounds { velocity: 1_000.0, acceleration: 5_000.0, deceleration: 2_500.0 };

    fn run(target: f64, steps: usize) -> (Ramp, usize, f64) {
        let mut ramp = Ramp::at(0.0);
        let mut furthest = 0.0f64;
        for step in 0..steps {
            let before = ramp.velocity;
            let arrived = ramp.towards_position(0.001, target, &BOUNDS);
            furthest = furthest.max(ramp.position.abs());
            if arrived {
                return (ramp, step, furthest);
            }
            assert!(ramp.velocity.abs() <= BOUNDS.velocity + 1e-6);
            assert!((ramp.velocity - before).abs() <= BOUNDS.acceleration * 0.001 + 1e-6);
        }
        (ramp, steps, furthest)
    }

    #[test]
    fn motion_is_trapezoid_without_overshoot() {
        for target in [1_000.0, -1_000.0, 10.0, 1.0, 0.25, 0.0] {
            let (ramp, _, furthest) = run(target, 5_000);
            assert_eq!(ramp, Ramp::at(target), "{target}");
            assert!(furthest <= target.abs() + 0.01, "{target}: {furthest}");
        }
        // 0.2 s up, 0.4 s down, which is 300 of 1000 increments; 0.7 s at full speed
        let (_, steps, _) = run(1_000.0, 5_000);
        assert!((1_290..1_320).contains(&steps), "{steps}");
    }

    #[test]
    fn velocity_changes_with_acceleration_and_deceleration() {
        let mut ramp = Ramp::at(0.0);
        for _ in 0..100 {
            ramp.towards_velocity(0.001, 500.0, &BOUNDS);
        }
        assert!((ramp.velocity - 500.0).abs() < 1e-6);
        for _ in 0..100 {
            ramp.towards_velocity(0.001, 0.0, &BOUNDS);
        }
        assert!((ramp.velocity - 250.0).abs() < 1e-6);
    }
}
