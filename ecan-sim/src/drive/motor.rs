//! The motor and its position controller, in mechanical increments from a fixed zero.
//!
//! Uses only the basic operations of IEEE 754, so that every machine computes the same motion.

use super::config::MotorConfig;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Actuation {
    /// No current: friction stops the motor.
    Free,
    /// Follow a position that moves with this velocity.
    Position { position: f64, velocity: f64 },
    /// Velocity, increments per second.
    Velocity(f64),
    /// Torque, thousandths of the rated torque.
    Torque(f64),
}

#[derive(Clone, Debug)]
pub(super) struct Motor {
    config: MotorConfig,
    /// Increments from the mechanical zero.
    pub(super) position: f64,
    /// Increments per second.
    pub(super) velocity: f64,
    /// Thousandths of the rated torque.
    pub(super) torque: f64,
    pub(super) is_blocked: bool,
    /// Maximum torque, thousandths of the rated torque (0x6072).
    torque_limit: f64,
    velocity_limit: f64,
    /// Acceleration per thousandth of the rated torque.
    per_mille: f64,
    /// Acceleration at the maximum torque.
    available: f64,
    /// Feed-forward: added to the demands of the velocity and of the torque controller.
    pub(super) offsets: Offsets,
}

/// Offsets of the cyclic modes (0x60B1, 0x60B2).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Offsets {
    /// Increments per second.
    pub(super) velocity: f64,
    /// Thousandths of the rated torque.
    pub(super) torque: f64,
}

impl Motor {
    pub(super) fn new(config: MotorConfig) -> Self {
        let torque_limit = f64::from(config.max_torque);
        let per_mille = f64::from(config.max_acceleration) / f64::from(config.max_torque.max(1));
        Self {
            config,
            position: f64::from(config.start_position),
            velocity: 0.0,
            torque: 0.0,
            is_blocked: false,
            torque_limit,
            velocity_limit: f64::from(config.max_velocity),
            per_mille,
            available: torque_limit * per_mille,
            offsets: Offsets::default(),
        }
    }

    pub(super) const fn increments_per_revolution(&self) -> f64 {
        self.config.increments_per_revolution as f64
    }

    /// Maximum velocity of the motor and by 0x6080, increments per second.
    pub(super) const fn max_velocity(&self) -> f64 {
        self.velocity_limit
    }

    pub(super) fn limit_speed(&mut self, rpm: u32) {
        let limit = f64::from(rpm) * self.increments_per_revolution() / 60.0;
        self.velocity_limit = limit.min(f64::from(self.config.max_velocity));
    }

    pub(super) const fn max_acceleration(&self) -> f64 {
        self.config.max_acceleration as f64
    }

    pub(super) fn limit_torque(&mut self, per_mille: u16) {
        self.torque_limit = f64::from(per_mille.min(self.config.max_torque));
        self.available = self.torque_limit * self.per_mille;
    }

    /// Returns whether the motor is slow enough for a stop to be complete: 0.01 revolutions per
    /// second.
    pub(super) fn has_settled(&self) -> bool {
        self.velocity.abs() * 100.0 < f64::from(self.config.increments_per_revolution)
    }

    pub(super) fn advance(&mut self, seconds: f64, actuation: Actuation) {
        let before = self.velocity;
        let acceleration = match actuation {
            Actuation::Free => 0.0,
            Actuation::Position { position, velocity } => {
                // Both refer to the end of the step, the error to its beginning.
                let demand = self.controlled(position - velocity * seconds, velocity);
                self.effort(demand, seconds)
            }
            Actuation::Velocity(velocity) => {
                let limit = self.max_velocity();
                let velocity = velocity + self.offsets.velocity;
                self.effort(velocity.clamp(-limit, limit), seconds)
            }
            Actuation::Torque(torque) => {
                let torque = torque + self.offsets.torque;
                torque.clamp(-self.torque_limit, self.torque_limit) * self.per_mille
            }
        };
        self.torque = acceleration / self.per_mille;
        if self.is_blocked {
            self.velocity = 0.0;
            return;
        }
        self.velocity = self.pushed(acceleration, seconds);
        self.position += (before + self.velocity) / 2.0 * seconds;
    }

    /// Velocity that the position controller demands.
    fn controlled(&self, position: f64, velocity: f64) -> f64 {
        let error = position - self.position;
        let gain = f64::from(self.config.position_gain);
        // Never faster towards the target than the motor can brake.
        let bound = (self.available * error.abs()).sqrt();
        let correction = (gain * error).clamp(-bound, bound);
        let fed_forward = velocity * f64::from(self.config.feed_forward) / 1_000.0;
        let limit = self.max_velocity();
        (fed_forward + self.offsets.velocity + correction).clamp(-limit, limit)
    }

    /// Acceleration that reaches a velocity within one step and overcomes friction.
    fn effort(&self, velocity: f64, seconds: f64) -> f64 {
        if seconds <= 0.0 {
            return 0.0;
        }
        let moving = if velocity == 0.0 { self.velocity } else { velocity };
        let friction = f64::from(self.config.friction);
        let drag = if moving == 0.0 { 0.0 } else { friction.copysign(moving) };
        let wanted = (velocity - self.velocity) / seconds + drag;
        (wanted + self.offsets.torque * self.per_mille).clamp(-self.available, self.available)
    }

    /// Velocity after a step with this acceleration; friction only brakes.
    fn pushed(&self, acceleration: f64, seconds: f64) -> f64 {
        let driven = self.velocity + acceleration * seconds;
        let drag = f64::from(self.config.friction) * seconds;
        let slowed = if driven > drag {
            driven - drag
        } else if driven < -drag {
            driven + drag
        } else {
            0.0
        };
        let limit = self.max_velocity();
        slowed.clamp(-limit, limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 0.001;

    fn motor() -> Motor {
        Motor::new(MotorConfig::default())
    }

    #[test]
    fn friction_stops_free_motor() {
        let mut motor = motor();
        for _ in 0..100 {
            motor.advance(STEP, Actuation::Velocity(1_000_000.0));
        }
        assert!((motor.velocity - 1_000_000.0).abs() < 1.0);
        let turning = motor.position;
        // 1e6 increments/s at 5e6 increments/s²: 200 ms and 100 000 increments
        for _ in 0..201 {
            motor.advance(STEP, Actuation::Free);
        }
        assert!(motor.velocity == 0.0);
        assert_eq!(motor.torque, 0.0);
        assert!((motor.position - turning - 100_000.0).abs() < 1_000.0);
    }

    #[test]
    fn moving_position_is_followed_with_small_error() {
        let mut motor = motor();
        let mut demand = 0.0;
        for _ in 0..1_000 {
            demand += 100.0;
            motor.advance(STEP, Actuation::Position { position: demand, velocity: 100_000.0 });
        }
        let error = demand - motor.position;
        // 2 % of 100 000 increments/s not fed forward, over a gain of 200/s, is 10 increments
        assert!((5.0..70.0).contains(&error), "following error {error}");
        for _ in 0..1_000 {
            motor.advance(STEP, Actuation::Position { position: demand, velocity: 0.0 });
        }
        assert!((demand - motor.position).abs() < 0.5);
        assert!(motor.has_settled());
    }

    #[test]
    fn acceleration_velocity_and_torque_are_limited() {
        let mut motor = motor();
        let config = MotorConfig::default();
        let mut fastest = 0.0f64;
        for _ in 0..200 {
            let before = motor.velocity;
            motor.advance(STEP, Actuation::Position { position: 1e9, velocity: 0.0 });
            let acceleration = (motor.velocity - before) / STEP;
            assert!(acceleration <= f64::from(config.max_acceleration) + 1.0);
            assert!(motor.torque <= f64::from(config.max_torque) + 1e-9);
            fastest = fastest.max(motor.velocity);
        }
        assert_eq!(fastest, f64::from(config.max_velocity));
    }

    #[test]
    fn small_torque_does_not_overcome_friction() {
        let mut motor = motor();
        // friction is 5e6 of 2e8 increments/s² at 3000 thousandths: 75 thousandths
        for _ in 0..100 {
            motor.advance(STEP, Actuation::Torque(70.0));
        }
        assert_eq!((motor.velocity, motor.position), (0.0, 0.0));
        for _ in 0..100 {
            motor.advance(STEP, Actuation::Torque(150.0));
        }
        assert!((motor.velocity - 500_000.0).abs() < 1_000.0);
    }

    #[test]
    fn blocked_motor_has_torque_and_stays() {
        let mut motor = motor();
        motor.is_blocked = true;
        for _ in 0..10 {
            motor.advance(STEP, Actuation::Position { position: 10_000.0, velocity: 0.0 });
        }
        assert_eq!(motor.position, 0.0);
        assert!(motor.torque > 1_000.0);
    }

    #[test]
    fn distant_target_is_reached_without_overshoot() {
        let mut motor = motor();
        let mut furthest = 0.0f64;
        for _ in 0..3_000 {
            motor.advance(STEP, Actuation::Position { position: 300_000.0, velocity: 0.0 });
            furthest = furthest.max(motor.position);
        }
        assert!((motor.position - 300_000.0).abs() < 0.5);
        assert!(furthest < 300_500.0, "{furthest}");
    }
}
