//! Limits of an axis in increments: of its machine, converted to a target period, and of its drive.

use std::f64::consts::TAU;
use std::time::Duration;

use ecan_canopen::{OperatingMode, Step, object};

use super::config::{AxisConfig, target_kind};
use super::error::AxisFault;
use super::ramp::{FRACTION_BITS, RampLimits};
use super::units::{DriveUnits, MotionLimit};
use crate::guard::terms::{GuardLimits, TargetKind};

/// Modes in which the host limits the motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LimitedMode {
    Position,
    Velocity,
    /// The drive generates its acceleration.
    ProfileVelocity,
}

impl LimitedMode {
    fn of(mode: OperatingMode) -> Option<Self> {
        match mode {
            OperatingMode::CyclicVelocity => Some(Self::Velocity),
            OperatingMode::ProfileVelocity => Some(Self::ProfileVelocity),
            mode if target_kind(mode) == TargetKind::Position => Some(Self::Position),
            _ => None,
        }
    }

    fn has(self, limit: MotionLimit) -> bool {
        self != Self::ProfileVelocity || limit == MotionLimit::Velocity
    }
}

/// The largest whole number of units that does not exceed a limit, at most 2^32 - 1 and 2^`bits` of
/// them per unit. `unit` is the value of one.
fn whole_units(limit: f64, unit: f64, bits: u32) -> u64 {
    let fine = unit / (1_u64 << bits) as f64;
    // The cast saturates and drops the fraction.
    let count = ((limit / fine) as u64).min(u64::MAX >> (FRACTION_BITS - bits));
    // The quotient may have been rounded up.
    if count as f64 * fine > limit { count.saturating_sub(1) } else { count }
}

impl AxisConfig {
    /// Checks what does not depend on the target period.
    pub(crate) fn check_limits(&self, report: &mut dyn FnMut(AxisFault)) {
        let (mode, scale) = (self.mode, self.scale);
        let kind = LimitedMode::of(mode);
        for (limit, value) in self.limits.iter() {
            if !(value.is_normal() && value > 0.0) {
                report(AxisFault::Limit { limit, value });
            } else if !kind.is_some_and(|kind| kind.has(limit)) {
                report(AxisFault::LimitMode { limit, mode });
            } else if kind != Some(LimitedMode::Position) && scale.velocity_units().is_none() {
                report(AxisFault::LimitUnits { limit, mode });
            }
        }
    }

    /// The configuration with its [`MotionLimits`] converted to increments at a target period, as
    /// the axis applies them. Reports a limit that cannot be kept.
    pub(crate) fn at_period(
        &self,
        target_period: Duration,
        report: &mut dyn FnMut(AxisFault),
    ) -> (Self, RampLimits) {
        let mut config = self.clone();
        let mut ramp = RampLimits::increments(self.ramp);
        let Some(mode) = LimitedMode::of(self.mode) else { return (config, ramp) };
        let seconds = target_period.as_secs_f64();
        // rad/s of one unit of the rate that a target period changes.
        let unit = match (mode, self.scale.velocity_units()) {
            (LimitedMode::Position, _) => TAU / (self.scale.steps().abs() * seconds),
            (_, Some(units)) => TAU / units.abs(),
            (_, None) => return (config, ramp),
        };
        let is_position = mode == LimitedMode::Position;
        for (limit, value) in self.limits.iter() {
            let (unit, bits) = match limit {
                MotionLimit::Velocity => (unit, 0),
                MotionLimit::Acceleration => {
                    (unit / seconds, if is_position { FRACTION_BITS } else { 0 })
                }
                MotionLimit::Jerk => (unit / seconds / seconds, FRACTION_BITS),
            };
            let count = whole_units(value, unit, bits);
            if count == 0 {
                let unit = unit / (1_u64 << bits) as f64;
                report(AxisFault::LimitResolution { limit, value, unit, target_period });
                continue;
            }
            let whole = u32::try_from(count).unwrap_or(u32::MAX);
            match (limit, mode) {
                (MotionLimit::Velocity, LimitedMode::Position) => {
                    config = config.with_step_limit(whole);
                }
                (MotionLimit::Velocity, _) => config.narrow_bounds(whole),
                (MotionLimit::Acceleration, LimitedMode::Position) => {
                    ramp = RampLimits::new(count.into(), ramp.jerk());
                }
                (MotionLimit::Acceleration, _) => config.step_limit = whole,
                (MotionLimit::Jerk, _) => ramp = ramp.with_jerk(count.into()),
            }
        }
        if is_position && let Some(velocity) = self.limits.velocity {
            let (step, limit) = (config.target_step, config.step_limit);
            if step.unsigned_abs() > limit {
                let fault = AxisFault::TargetStepVelocity { step, limit, velocity, target_period };
                report(fault);
            }
        }
        config.limit_feed_forward(target_period);
        (config, ramp)
    }

    /// A velocity offset is at most the velocity of the step limit, if its unit is known.
    fn limit_feed_forward(&mut self, target_period: Duration) {
        let Some(units) = self.scale.velocity_units() else { return };
        let turns = f64::from(self.step_limit) / self.scale.steps().abs();
        // The cast saturates and drops the fraction; at least 1, since a limit of 0 is a fault.
        let most = (turns / target_period.as_secs_f64() * units.abs()) as u32;
        self.feed_forward.velocity = self.feed_forward.velocity.min(most.max(1));
    }

    /// Narrows bounds, which include 0, to a limit of both directions.
    fn narrow_bounds(&mut self, limit: u32) {
        let limit = i32::try_from(limit).unwrap_or(i32::MAX);
        let (min, max) = self.bounds.unwrap_or((-limit, limit));
        self.bounds = Some((min.max(-limit), max.min(limit)));
    }
}

/// Limits of a drive, read at the end of its configuration; `None` for an object that it does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DriveLimits {
    /// Largest torque 0x6072, in thousandths of the rated torque.
    pub max_torque: Option<u16>,
    /// Software position limits 0x607D, in steps. Without effect if the first is not below the second.
    pub position: Option<(i32, i32)>,
    /// Largest speed of the motor 0x6080, in revolutions per minute.
    pub max_motor_speed: Option<u32>,
}

impl DriveLimits {
    pub(crate) fn steps() -> impl Iterator<Item = Step> {
        let objects = [
            (object::MAX_TORQUE, 0),
            (object::SOFTWARE_POSITION_LIMIT, 1),
            (object::SOFTWARE_POSITION_LIMIT, 2),
            (object::MAX_MOTOR_SPEED, 0),
        ];
        let read = |(index, subindex)| Step::read(index, subindex).named("limits").if_accepted();
        objects.into_iter().map(read)
    }

    pub(crate) fn from_values(value: impl Fn(u16, u8) -> Option<u64>) -> Self {
        let signed = |subindex| Some(value(object::SOFTWARE_POSITION_LIMIT, subindex)? as u32);
        Self {
            max_torque: value(object::MAX_TORQUE, 0).and_then(|raw| u16::try_from(raw).ok()),
            position: signed(1)
                .zip(signed(2))
                .map(|(low, high)| (low.cast_signed(), high.cast_signed())),
            max_motor_speed: value(object::MAX_MOTOR_SPEED, 0)
                .and_then(|raw| u32::try_from(raw).ok()),
        }
    }

    /// Narrows the limits of the guard in a mode to those of the drive; never widens one.
    pub(crate) fn narrow(
        &self,
        limits: &mut GuardLimits,
        (mode, config): (OperatingMode, &AxisConfig),
        units: &DriveUnits,
        target_period_ns: u64,
    ) {
        match target_kind(mode) {
            TargetKind::Position | TargetKind::Profile => {
                if let Some((low, high)) = self.position.filter(|(low, high)| low < high) {
                    limits.bounds = narrowed(limits.bounds, (low, high));
                }
            }
            TargetKind::Rate if is_torque(mode) => {
                if let Some(most) = self.max_torque {
                    limits.bounds = narrowed(limits.bounds, (-i32::from(most), most.into()));
                }
            }
            TargetKind::Rate | TargetKind::None => {}
        }
        let Some(turns_per_s) = self.max_motor_speed.map(|speed| f64::from(speed) / 60.0) else {
            return;
        };
        match mode {
            OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition => {
                if let Some(steps) = units.steps_per_motor_turn() {
                    // The cast saturates and drops the fraction.
                    let most = turns_per_s * steps * target_period_ns as f64 / 1e9;
                    limits.step = limits.step.min((most as u32).max(1));
                }
            }
            OperatingMode::CyclicVelocity | OperatingMode::ProfileVelocity => {
                let per_shaft = config.scale.velocity_units().or_else(|| units.velocity_units());
                if let Some(most) = per_shaft
                    .zip(units.steps_per_turn().zip(units.steps_per_motor_turn()))
                    .map(|(units, (shaft, motor))| turns_per_s * units.abs() * motor / shaft)
                {
                    let most = most as i32;
                    limits.bounds = narrowed(limits.bounds, (-most, most));
                }
            }
            _ => {}
        }
    }
}

fn is_torque(mode: OperatingMode) -> bool {
    matches!(mode, OperatingMode::ProfileTorque | OperatingMode::CyclicTorque)
}

/// The bounds that are in both; those of the configuration if they have nothing in common.
fn narrowed(bounds: Option<(i32, i32)>, (low, high): (i32, i32)) -> Option<(i32, i32)> {
    let Some((min, max)) = bounds else { return Some((low, high)) };
    let both = (min.max(low), max.min(high));
    Some(if both.0 <= both.1 { both } else { (min, max) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::units::{MotionLimits, Scale};
    use crate::guard::terms::PositionRange;
    use ecan_canopen::{NodeAddress, NodeId};
    use proptest::prelude::*;

    const PERIOD: Duration = Duration::from_millis(10);
    const ONE: f64 = (1_u64 << FRACTION_BITS) as f64;

    fn config(mode: OperatingMode, limits: MotionLimits) -> AxisConfig {
        let node = NodeId::new(1).unwrap();
        let mut config = AxisConfig::new(NodeAddress { slave: 0, channel: 0, node });
        config.scale = Scale::steps_per_turn(-204_800.0).with_velocity_units(600.0);
        config.mode = mode;
        config.limits = limits;
        config
    }

    fn all(velocity: f64, acceleration: f64, jerk: f64) -> MotionLimits {
        MotionLimits {
            velocity: Some(velocity),
            acceleration: Some(acceleration),
            jerk: Some(jerk),
        }
    }

    fn faults(config: &AxisConfig, target_period: Duration) -> Vec<String> {
        let mut faults = Vec::new();
        config.check(&mut |fault| faults.push(fault.to_string()));
        if faults.is_empty() {
            config.at_period(target_period, &mut |fault| faults.push(fault.to_string()));
        }
        faults
    }

    fn at_period(config: &AxisConfig) -> (AxisConfig, RampLimits) {
        config.at_period(PERIOD, &mut |fault| panic!("{fault}"))
    }

    #[test]
    fn position_limits_are_increments_per_target_period() {
        // One turn per second, 1 turn/s^2, 10 turns/s^3.
        let config = config(OperatingMode::CyclicPosition, all(TAU, TAU, 10.0 * TAU));
        let (config, ramp) = at_period(&config);
        assert_eq!((config.step_limit, config.following_window), (2_048, 16_384));
        assert!((ramp.change() as f64 / ONE - 20.48).abs() < 1e-6, "{ramp:?}");
        assert!((ramp.jerk() as f64 / ONE - 2.048).abs() < 1e-6, "{ramp:?}");
    }

    #[test]
    fn velocity_limits_are_units_of_the_drive() {
        let limits = all(TAU, 10.0 * TAU, 100.0 * TAU);
        let (limited, ramp) = at_period(&config(OperatingMode::CyclicVelocity, limits));
        assert_eq!((limited.bounds, limited.step_limit), (Some((-600, 600)), 60));
        assert!((ramp.jerk() as f64 / ONE - 6.0).abs() < 1e-6, "{ramp:?}");
        let mut bounded = config(OperatingMode::CyclicVelocity, limits);
        bounded.bounds = Some((-100, 2_000));
        assert_eq!(at_period(&bounded).0.bounds, Some((-100, 600)));
    }

    #[test]
    fn limit_that_the_host_cannot_keep_is_rejected() {
        for (mode, count) in [
            (OperatingMode::ProfilePosition, 3),
            (OperatingMode::CyclicTorque, 3),
            (OperatingMode::ProfileTorque, 3),
            (OperatingMode::ProfileVelocity, 2),
        ] {
            let faults = faults(&config(mode, all(1.0, 10.0, 100.0)), PERIOD);
            assert_eq!(faults.len(), count, "{mode}: {faults:?}");
        }
        let mut unknown = config(OperatingMode::CyclicVelocity, all(1.0, 10.0, 100.0));
        unknown.scale = Scale::steps_per_turn(100.0);
        let text = faults(&unknown, PERIOD).join("\n");
        assert!(text.contains("velocity limit") && text.contains("velocity units"), "{text}");
    }

    #[test]
    fn invalid_limit_is_rejected() {
        for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let limited = config(OperatingMode::CyclicPosition, all(value, value, value));
            assert_eq!(faults(&limited, PERIOD).len(), 3, "{value}");
        }
        let mut limited = config(OperatingMode::CyclicPosition, all(1e-3, 1e-11, 1e-10));
        let text = faults(&limited, PERIOD).join("\n");
        assert!(text.contains("velocity limit 0.001 rad/s is below 0.00306796"), "{text}");
        assert_eq!(faults(&limited, PERIOD).len(), 3, "{text}");
        limited.limits = MotionLimits { velocity: Some(TAU), ..MotionLimits::default() };
        limited.target_step = -2_049;
        let text = faults(&limited, PERIOD).join("\n");
        assert!(text.contains("-2049") && text.contains("2048") && text.contains("6.28"), "{text}");
    }

    #[test]
    fn huge_limit_saturates() {
        let config = config(OperatingMode::CyclicPosition, all(1e300, 1e300, 1e300));
        let (config, ramp) = at_period(&config);
        assert_eq!(config.step_limit, u32::MAX);
        assert!(ramp.change() > 0 && ramp.jerk() > 0);
    }

    proptest! {
        #[test]
        fn conversion_never_exceeds_the_limit(
            velocity in 1e-4_f64..1e4, acceleration in 1e-4_f64..1e6, jerk in 1e-4_f64..1e9,
            steps in 1.0_f64..1e9, cycles in 1_u32..40, is_velocity: bool,
        ) {
            let mode = if is_velocity {
                OperatingMode::CyclicVelocity
            } else {
                OperatingMode::CyclicPosition
            };
            let period = Duration::from_micros(250) * cycles;
            let mut config = config(mode, all(velocity, acceleration, jerk));
            config.scale = Scale::steps_per_turn(steps).with_velocity_units(-steps);
            let mut faults = Vec::new();
            let (config, ramp) = config.at_period(period, &mut |fault| faults.push(fault));
            let has = |limit| {
                let is_this = |fault: &AxisFault| {
                    matches!(fault, AxisFault::LimitResolution { limit: it, .. } if *it == limit)
                };
                !faults.iter().any(is_this)
            };
            let seconds = period.as_secs_f64();
            let radians = TAU / steps;
            // Values after the conversion in rad/s, rad/s^2 and rad/s^3.
            let [rate, change, jerk_out] = if is_velocity {
                let bound = config.bounds.map_or(0, |(_, max)| max);
                [f64::from(bound) * radians, f64::from(config.step_limit) * radians / seconds,
                    ramp.jerk() as f64 / ONE * radians / seconds / seconds]
            } else {
                [f64::from(config.step_limit) * radians / seconds,
                    ramp.change() as f64 / ONE * radians / seconds / seconds,
                    ramp.jerk() as f64 / ONE * radians / seconds.powi(3)]
            };
            let pairs = [
                (MotionLimit::Velocity, rate, velocity),
                (MotionLimit::Acceleration, change, acceleration),
                (MotionLimit::Jerk, jerk_out, jerk),
            ];
            for (limit, converted, value) in pairs {
                // The last bits of the calculation above.
                let allowed = value * (1.0 + 1e-14);
                prop_assert!(!has(limit) || converted <= allowed, "{} {} {}", limit, converted, value);
            }
        }
    }

    #[test]
    fn guard_limits_are_narrowed_by_the_drive() {
        let node = NodeId::new(1).unwrap();
        let mut config = AxisConfig::new(NodeAddress { slave: 0, channel: 0, node });
        config.bounds = Some((-1_000, 50_000));
        let drive = DriveLimits {
            max_torque: Some(300),
            position: Some((-5_000, 20_000)),
            max_motor_speed: Some(60),
        };
        let units = DriveUnits { encoder: Some((65_536, 1)), ..DriveUnits::default() };
        let limits = |mode, units: &DriveUnits| {
            let mut limits = config.guard_limits(mode, 1);
            drive.narrow(&mut limits, (mode, &config), units, 2_000_000);
            (limits.bounds, limits.step)
        };
        let csp = OperatingMode::CyclicPosition;
        // One revolution per second in 2 ms.
        assert_eq!(limits(csp, &units), (Some((-1_000, 20_000)), 131));
        assert_eq!(limits(csp, &DriveUnits::default()).1, 1_000, "units unknown");
        config.bounds = None;
        let torque = OperatingMode::CyclicTorque;
        let mut narrow = config.guard_limits(torque, 1);
        drive.narrow(&mut narrow, (torque, &config), &units, 2_000_000);
        assert_eq!((narrow.bounds, narrow.range), (Some((-300, 300)), PositionRange::Linear));
        assert_eq!(narrowed(Some((1, 2)), (3, 4)), Some((1, 2)), "nothing in common");
    }
}
