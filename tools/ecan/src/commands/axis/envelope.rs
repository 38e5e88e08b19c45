//! Limits of a motion in steps, and the configuration of an axis that keeps them.

use std::f64::consts::TAU;
use std::time::Duration;

use ecan_canopen::{OperatingMode, Step, object};
use ecan_cia402::{AxisConfig, GuardLimits, MotionLimits, TargetKind};

use super::position_profile::ProfileLimits;
use super::unit::AxisUnits;

/// Steps per target period that the velocity limit should have: its resolution.
const LEAST_STEPS: f64 = 8.0;
/// Longest target period.
const LONGEST_PERIOD: Duration = Duration::from_millis(20);
/// Distance beyond the range that is tolerated, in seconds of motion at the maximum velocity.
const OVERSHOOT: f64 = 0.05;
/// Noise of an actual position, in steps.
pub const NOISE: f64 = 20.0;
/// Following error that is allowed at the maximum velocity, in seconds of motion.
const LAG: f64 = 0.1;
/// Smallest window of the following error, in steps.
const LEAST_WINDOW: f64 = 100.0;

/// Limits of a motion in steps and seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Envelope {
    /// Steps/s, above 0.
    pub velocity: f64,
    /// Steps/s^2, above 0.
    pub acceleration: f64,
    pub min: i32,
    pub max: i32,
}

impl Envelope {
    pub fn profile(&self) -> ProfileLimits {
        ProfileLimits { velocity: self.velocity, acceleration: self.acceleration }
    }

    /// Returns whether a target is in the range.
    pub fn contains(&self, steps: f64) -> bool {
        (f64::from(self.min)..=f64::from(self.max)).contains(&steps)
    }

    /// Returns whether an actual position is in the range, or beyond it by overshoot and noise.
    pub fn admits(&self, steps: f64) -> bool {
        let tolerance = self.tolerance();
        (f64::from(self.min) - tolerance..=f64::from(self.max) + tolerance).contains(&steps)
    }

    /// The range of positions in the unit of the axis.
    pub fn text(&self, units: &AxisUnits) -> String {
        let (min, max) = (units.position(self.min.into()), units.position(self.max.into()));
        format!("{}..{} {}", units.number(min.min(max)), units.number(min.max(max)), units.unit)
    }

    /// Overshoot and noise of an actual position, in steps.
    pub fn tolerance(&self) -> f64 {
        self.velocity * OVERSHOOT + NOISE
    }

    /// Cycles from target to target: few enough for smooth motion, and enough for a velocity limit of
    /// several steps, which are whole numbers.
    pub fn motion_div(&self, cycle: Duration) -> u32 {
        let cycle_s = cycle.as_secs_f64().max(1e-6);
        let most = (LONGEST_PERIOD.as_secs_f64() / cycle_s).floor().max(1.0);
        (LEAST_STEPS / (self.velocity * cycle_s)).ceil().clamp(1.0, most) as u32
    }

    /// Configures CSP with these limits.
    pub fn apply_csp(&self, config: &mut AxisConfig, target_period: Duration) {
        config.mode = OperatingMode::CyclicPosition;
        config.outputs.clear();
        config.bounds = Some((self.min, self.max));
        let radians = TAU / config.scale.steps().abs();
        config.limits = MotionLimits {
            velocity: None,
            acceleration: Some(self.acceleration * radians),
            jerk: config.limits.jerk,
        };
        config.target_step = 0;
        let limit = (self.velocity * target_period.as_secs_f64()).ceil().max(1.0) as u32;
        config.following_window = (self.velocity * LAG).max(LEAST_WINDOW).ceil() as u32;
        *config = config.clone().with_step_limit(limit);
    }

    /// Configures PP with these limits in the objects of the drive.
    pub fn apply_pp(&self, config: &mut AxisConfig) {
        config.mode = OperatingMode::ProfilePosition;
        config.outputs.clear();
        config.bounds = Some((self.min, self.max));
        config.limits = MotionLimits::default();
        config.target_step = 0;
        let velocity = self.drive_units(config, self.velocity);
        let acceleration = self.drive_units(config, self.acceleration);
        let limits = [
            (object::PROFILE_VELOCITY, velocity),
            (object::PROFILE_ACCELERATION, acceleration),
            (object::PROFILE_DECELERATION, acceleration),
        ]
        .map(|(index, value)| Step::write(config.object_index(index), 0, value));
        config.drive.further.extend(limits);
    }

    /// Configures CSV with these limits. The guard limits velocity and acceleration; the position has to be
    /// watched.
    pub fn apply_csv(&self, config: &mut AxisConfig, target_period: Duration) {
        config.mode = OperatingMode::CyclicVelocity;
        config.outputs.clear();
        config.limits = MotionLimits::default();
        config.target_step = 0;
        let velocity = self.drive_units(config, self.velocity);
        let most = i32::try_from(velocity).unwrap_or(i32::MAX);
        config.bounds = Some((-most, most));
        // Targets are rounded: their changes differ by up to one unit.
        let change = self.acceleration * target_period.as_secs_f64() * velocity_factor(config);
        config.step_limit = change.abs().ceil().max(1.0) as u32;
        config.ramp = config.step_limit;
        // Of positions, not of velocities.
        config.standstill = config.standstill.min(config.step_limit);
    }

    /// The same within the limits of the guard, which those of the drive narrow; `factor` is the
    /// [`velocity_factor`] of the axis.
    #[must_use]
    pub fn within(&self, guard: &GuardLimits, target_period: Duration, factor: f64) -> Self {
        let mut envelope = *self;
        let bounds = guard.bounds.filter(|(low, high)| low < high);
        match guard.kind {
            TargetKind::Rate => {
                let most = bounds.map(|(low, high)| f64::from(high.min(low.saturating_neg())));
                let most = most.map(|most| most / factor.abs()).filter(|most| *most > 0.0);
                envelope.velocity = most.map_or(self.velocity, |most| self.velocity.min(most));
            }
            TargetKind::Position | TargetKind::Profile | TargetKind::None => {
                if let Some((low, high)) = bounds {
                    (envelope.min, envelope.max) = (self.min.max(low), self.max.min(high));
                }
                if guard.kind == TargetKind::Position {
                    let most = f64::from(guard.step) / target_period.as_secs_f64();
                    envelope.velocity = self.velocity.min(most);
                }
            }
        }
        envelope
    }

    /// Velocity of the drive for steps per second, at least 1.
    pub fn drive_units(&self, config: &AxisConfig, steps_per_second: f64) -> u32 {
        (steps_per_second * velocity_factor(config)).abs().floor().max(1.0) as u32
    }
}

/// Units of the velocity of a drive for one step per second. Without a unit a drive counts steps per second.
pub fn velocity_factor(config: &AxisConfig) -> f64 {
    config.scale.velocity_units().map_or(1.0, |units| units / config.scale.steps())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::{NodeAddress, NodeId};
    use ecan_cia402::Scale;

    const ENVELOPE: Envelope =
        Envelope { velocity: 9_000.0, acceleration: 18_000.0, min: -1_000, max: 1_000 };

    fn config() -> AxisConfig {
        let node = NodeId::new(1).unwrap();
        let mut config = AxisConfig::new(NodeAddress { slave: 0, channel: 0, node });
        config.scale = Scale::steps_per_turn(36_000.0);
        config
    }

    #[test]
    fn profile_of_an_axis_is_written_to_its_objects() {
        let mut config = config().with_node_axis(2, 1);
        ENVELOPE.apply_pp(&mut config);
        let steps: Vec<_> = config.drive.further.iter().map(|it| it.action.to_string()).collect();
        let has = |nth: usize, part: &str| assert!(steps[nth].contains(part), "{steps:?}");
        has(0, "0x7081:00");
        has(1, "0x7083:00");
        has(2, "0x7084:00");
    }

    #[test]
    fn limits_of_the_drive_narrow_those_of_the_command() {
        let mut config = config();
        let envelope = ENVELOPE;
        let period = Duration::from_millis(1);
        envelope.apply_csp(&mut config, period);
        let mut guard = config.guard_limits(OperatingMode::CyclicPosition, 1);
        assert_eq!(envelope.within(&guard, period, 1.0), envelope);
        (guard.bounds, guard.step) = (Some((-5_000, 200)), 4);
        let narrow = envelope.within(&guard, period, 1.0);
        assert_eq!((narrow.min, narrow.max, narrow.velocity), (-1_000, 200, 4_000.0));
        envelope.apply_csv(&mut config, period);
        let mut guard = config.guard_limits(OperatingMode::CyclicVelocity, 1);
        guard.bounds = Some((-100, 90));
        assert_eq!(envelope.within(&guard, period, 0.1).velocity, 900.0);
    }

    #[test]
    fn actual_position_may_overshoot_the_range() {
        // 50 ms at 9,000 step/s, and noise.
        assert!(ENVELOPE.admits(1_470.0) && !ENVELOPE.admits(1_471.0));
        assert!(ENVELOPE.admits(-1_470.0) && !ENVELOPE.admits(-1_471.0));
        assert!(ENVELOPE.contains(1_000.0) && !ENVELOPE.contains(1_001.0));
    }

    #[test]
    fn slow_axis_gets_a_longer_target_period() {
        let envelope = |velocity| Envelope { velocity, acceleration: 1.0, min: 0, max: 1 };
        let cycle = Duration::from_millis(1);
        assert_eq!(envelope(100_000.0).motion_div(cycle), 1);
        assert_eq!(envelope(1_000.0).motion_div(cycle), 8);
        assert_eq!(envelope(1.0).motion_div(cycle), 20, "the longest period");
        assert_eq!(envelope(1.0).motion_div(Duration::from_millis(50)), 1);
    }

    #[test]
    fn guard_never_allows_less_than_the_profile_needs() {
        let mut config = config();
        let envelope = ENVELOPE;
        envelope.apply_csp(&mut config, Duration::from_millis(1));
        assert_eq!((config.step_limit, config.bounds), (9, Some((-1_000, 1_000))));
        assert_eq!((config.following_window, config.standstill), (900, 9));
        let mut faults = Vec::new();
        config.check(&mut |fault| faults.push(fault));
        assert_eq!(faults, []);
        envelope.apply_csv(&mut config, Duration::from_millis(1));
        config.check(&mut |fault| faults.push(fault));
        assert_eq!((faults, config.bounds, config.step_limit), (vec![], Some((-9_000, 9_000)), 18));
    }
}
