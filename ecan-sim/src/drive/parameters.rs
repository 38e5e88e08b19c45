//! Motion parameters, read from the object dictionary after every change, and the ramp whose velocity and
//! acceleration they limit.

use ecan_canopen::{
    FaultReaction, HaltOption, NodeLossReaction, QuickStopOption, StopOption, object,
};

use super::dictionary::{Dictionary, axis_index};
use super::motor::Motor;

/// Motion parameters; times in ns, positions in increments.
#[derive(Clone, Copy, Debug)]
pub(super) struct Parameters {
    pub(super) node_loss: NodeLossReaction,
    pub(super) quick_stop: QuickStopOption,
    pub(super) shutdown: StopOption,
    pub(super) disable_operation: StopOption,
    pub(super) halt: HaltOption,
    pub(super) fault_reaction: FaultReaction,
    pub(super) following_window: u32,
    pub(super) following_time: u64,
    pub(super) position_window: u32,
    pub(super) position_window_time: u64,
    pub(super) velocity_window: f64,
    pub(super) max_torque: u16,
    /// Revolutions per minute.
    pub(super) max_motor_speed: u32,
    pub(super) home_offset: i32,
    /// Software position limits; `None` if disabled.
    pub(super) limits: Option<(i32, i32)>,
    pub(super) profile: Bounds,
    pub(super) max_profile_velocity: f64,
    pub(super) quick_deceleration: f64,
    pub(super) homing_method: i8,
    pub(super) homing_fast: f64,
    pub(super) homing_slow: f64,
    pub(super) homing_acceleration: f64,
    pub(super) interpolation: u64,
    /// Set-points that wait in the buffer (0x60C4:02); `None` while its access is disabled
    /// (0x60C4:06).
    pub(super) interpolation_buffer: Option<usize>,
    /// Thousandths of the rated torque per second.
    pub(super) torque_slope: f64,
    pub(super) vl: VelocityMode,
}

/// Parameters of the velocity mode.
#[derive(Clone, Copy, Debug)]
pub(super) struct VelocityMode {
    /// Increments per second of one revolution per minute.
    unit: f64,
    /// Smallest and largest amount, revolutions per minute.
    limits: (f64, f64),
    pub(super) bounds: Bounds,
}

impl VelocityMode {
    fn read(dictionary: &Dictionary, axis: usize, motor: &Motor) -> Self {
        let number = |index, subindex| {
            dictionary.number(axis_index(axis, index), subindex).unwrap_or(0) as f64
        };
        let unit = motor.increments_per_revolution() / 60.0;
        let rate = |index| match (number(index, 1), number(index, 2)) {
            (speed, time) if speed > 0.0 && time > 0.0 => {
                (speed / time * unit).min(motor.max_acceleration())
            }
            _ => motor.max_acceleration(),
        };
        let limits = (number(object::VL_VELOCITY_LIMITS, 1), number(object::VL_VELOCITY_LIMITS, 2));
        Self {
            unit,
            limits,
            bounds: Bounds {
                velocity: motor.max_velocity(),
                acceleration: rate(object::VL_ACCELERATION),
                deceleration: rate(object::VL_DECELERATION),
            },
        }
    }

    /// Velocity of a target in revolutions per minute, in increments per second.
    pub(super) fn velocity(&self, target: f64) -> f64 {
        if target == 0.0 {
            return 0.0;
        }
        let (least, most) = self.limits;
        target.abs().max(least).min(most).copysign(target) * self.unit
    }
}

impl Parameters {
    pub(super) fn read(dictionary: &Dictionary, axis: usize, motor: &Motor) -> Self {
        let number = |index, subindex| dictionary.number(axis_index(axis, index), subindex);
        let or = |index, default: i64| number(index, 0).unwrap_or(default);
        let option = |index, default| or(index, default) as i16;
        let strongest = motor.max_acceleration();
        let fastest = motor.max_velocity();
        let rate = |index, most: f64| match number(index, 0) {
            Some(value) if value > 0 => (value as f64).min(most),
            _ => most,
        };
        let max_profile_velocity = rate(object::MAX_PROFILE_VELOCITY, fastest);
        let low = number(object::SOFTWARE_POSITION_LIMIT, 1);
        let high = number(object::SOFTWARE_POSITION_LIMIT, 2);
        let time = |index| or(index, 0).clamp(0, u16::MAX.into()) as u64 * 1_000_000;
        let homing_speed = |subindex| match number(object::HOMING_SPEEDS, subindex) {
            Some(value) if value > 0 => (value as f64).min(fastest),
            _ => fastest / 100.0,
        };
        Self {
            // A drive without 0x6007 enters a fault, the default of CiA 402-2.
            node_loss: NodeLossReaction::from_raw(option(object::ABORT_CONNECTION_OPTION, 1)),
            quick_stop: QuickStopOption::from_raw(option(object::QUICK_STOP_OPTION, 2)),
            shutdown: StopOption::from_raw(option(object::SHUTDOWN_OPTION, 0)),
            disable_operation: StopOption::from_raw(option(object::DISABLE_OPERATION_OPTION, 1)),
            halt: HaltOption::from_raw(option(object::HALT_OPTION, 1)),
            fault_reaction: FaultReaction::from_raw(option(object::FAULT_REACTION_OPTION, 2)),
            following_window: or(object::FOLLOWING_ERROR_WINDOW, i64::from(u32::MAX)) as u32,
            following_time: time(object::FOLLOWING_ERROR_TIME),
            position_window: or(object::POSITION_WINDOW, 100) as u32,
            position_window_time: time(object::POSITION_WINDOW_TIME),
            velocity_window: or(object::VELOCITY_WINDOW, 1_000) as f64,
            max_torque: or(object::MAX_TORQUE, i64::from(u16::MAX)) as u16,
            max_motor_speed: or(object::MAX_MOTOR_SPEED, i64::from(u32::MAX)) as u32,
            home_offset: or(object::HOME_OFFSET, 0) as i32,
            limits: match (low, high) {
                (Some(low), Some(high)) if low < high => Some((low as i32, high as i32)),
                _ => None,
            },
            profile: Bounds {
                velocity: rate(object::PROFILE_VELOCITY, max_profile_velocity),
                acceleration: rate(object::PROFILE_ACCELERATION, strongest),
                deceleration: rate(object::PROFILE_DECELERATION, strongest),
            },
            max_profile_velocity,
            quick_deceleration: rate(object::QUICK_STOP_DECELERATION, strongest),
            homing_method: or(object::HOMING_METHOD, 0) as i8,
            homing_fast: homing_speed(1),
            homing_slow: homing_speed(2),
            homing_acceleration: rate(object::HOMING_ACCELERATION, strongest),
            interpolation_buffer: (number(object::INTERPOLATION_BUFFER, 6) == Some(1))
                .then(|| number(object::INTERPOLATION_BUFFER, 2).unwrap_or(0).max(0) as usize),
            torque_slope: or(object::TORQUE_SLOPE, i64::from(u32::MAX)) as f64,
            vl: VelocityMode::read(dictionary, axis, motor),
            interpolation: interpolation_ns(
                number(object::INTERPOLATION_TIME, 1).unwrap_or(0),
                number(object::INTERPOLATION_TIME, 2).unwrap_or(-3),
            ),
        }
    }
}

/// Converts 0x60C2: value and power of ten of a second.
fn interpolation_ns(value: i64, power: i64) -> u64 {
    let value = value.clamp(0, 255) as u64;
    let exponent = (9 + power).clamp(0, 10) as u32;
    value.saturating_mul(10u64.pow(exponent))
}

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
    use super::{interpolation_ns, *};

    #[test]
    fn interpolation_time_has_power_of_ten() {
        assert_eq!(interpolation_ns(1, -3), 1_000_000);
        assert_eq!(interpolation_ns(10, -3), 10_000_000);
        assert_eq!(interpolation_ns(25, -4), 2_500_000);
        assert_eq!(interpolation_ns(1, -2), 10_000_000);
        assert_eq!(interpolation_ns(0, -3), 0);
        assert_eq!(interpolation_ns(1, -128), 1);
    }

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
