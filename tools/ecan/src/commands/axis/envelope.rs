//! Limits of a motion in steps: their options, the configuration of an axis that keeps them, and a
//! position profile within them.

use std::f64::consts::TAU;
use std::str::FromStr;
use std::time::Duration;

use clap::Args;
use ecan_canopen::{OperatingMode, Step, object};
use ecan_cia402::{AxisConfig, GuardLimits, MotionLimits, TargetKind};

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
        config.pdos.outputs.clear();
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
        config.pdos.outputs.clear();
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
        config.pdos.outputs.clear();
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

/// Time to reach the maximum velocity without `--acceleration`, in seconds.
const RAMP: f64 = 0.5;

/// `MIN..MAX`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionBounds {
    pub min: f64,
    pub max: f64,
}

impl FromStr for PositionBounds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || "expected MIN..MAX with MIN below MAX, for example -90..90".to_owned();
        let (min, max) = text.split_once("..").ok_or_else(wrong)?;
        let number =
            |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        let (min, max) = number(min).zip(number(max)).ok_or_else(wrong)?;
        if min < max { Ok(Self { min, max }) } else { Err(wrong()) }
    }
}

pub fn parse_number(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|value: &f64| value.is_finite());
    number.ok_or_else(|| "expected a number".to_owned())
}

pub fn parse_positive(text: &str) -> Result<f64, String> {
    parse_number(text)
        .ok()
        .filter(|number| *number > 0.0)
        .ok_or_else(|| "expected a number above 0".to_owned())
}

#[derive(Clone, Copy, Debug, Args)]
#[command(next_help_heading = "Limits (no defaults; those of a file apply too)")]
pub struct LimitArguments {
    /// Largest velocity, in UNIT/s
    #[arg(long, value_name = "VELOCITY", value_parser = parse_positive)]
    max_velocity: f64,
    /// Allowed positions in UNIT; of `home`: allowed travel from the start
    #[arg(long, value_name = "MIN..MAX", allow_hyphen_values = true)]
    range: PositionBounds,
    /// Acceleration and deceleration, in UNIT/s^2 [default: of the file, or --max-velocity in 0.5 s]
    #[arg(long, value_name = "ACCELERATION", value_parser = parse_positive)]
    acceleration: Option<f64>,
}

impl LimitArguments {
    /// The narrower of these limits and those of the file.
    pub fn envelope(&self, units: &AxisUnits, config: &AxisConfig) -> Result<Envelope, String> {
        let per_radian = config.scale.steps().abs() / TAU;
        let of_file = |limit: Option<f64>| limit.map(|limit| limit * per_radian);
        let velocity = units.length(self.max_velocity).abs();
        let velocity =
            of_file(config.limits.velocity).map_or(velocity, |limit| velocity.min(limit));
        let acceleration = self.acceleration.map(|acceleration| units.length(acceleration).abs());
        let acceleration = match (acceleration, of_file(config.limits.acceleration)) {
            (Some(own), Some(file)) => own.min(file),
            (own, file) => own.or(file).unwrap_or(velocity / RAMP),
        };
        let (a, b) = (units.steps(self.range.min), units.steps(self.range.max));
        // The casts saturate: the counter of the drive has no more.
        let (mut min, mut max) = (a.min(b).ceil() as i32, a.max(b).floor() as i32);
        if let (Some(bounds), true) = (config.bounds, is_position(config.mode)) {
            (min, max) = (min.max(bounds.0), max.min(bounds.1));
        }
        if min >= max {
            return Err(format!(
                "--range {}..{} {} has no position in common with the limits of the file",
                self.range.min, self.range.max, units.unit
            ));
        }
        Ok(Envelope { velocity, acceleration, min, max })
    }

    pub fn range(&self) -> PositionBounds {
        self.range
    }
}

fn is_position(mode: OperatingMode) -> bool {
    use OperatingMode as Mode;
    matches!(mode, Mode::CyclicPosition | Mode::InterpolatedPosition | Mode::ProfilePosition)
}

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
    pub fn at_standstill(&self) -> Self {
        Self::at_rest(self.position)
    }
}

#[cfg(test)]
mod tests {
    use ecan_canopen::{NodeAddress, NodeId};
    use ecan_cia402::Scale;
    use proptest::prelude::*;

    use super::*;

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
        let steps: Vec<_> =
            config.drive.further.iter().map(|step| step.action.to_string()).collect();
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
        let most = profiles.iter().map(|profile| profile.velocity).fold(0.0, f64::max);
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
            prop_assert!(velocities.iter().all(|speed| speed.abs() <= velocity * 1.000_001));
            // The last period before rest has an eighth more: it ends at the goal, not near it.
            let most = velocities.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
            prop_assert!(most <= change * 1.126, "{most} {change}");
        }
    }
}

#[cfg(test)]
mod limit_arguments_tests {
    use ecan_canopen::{NodeAddress, NodeId};
    use ecan_cia402::Scale;

    use super::*;
    use crate::commands::axis::unit::Unit;

    fn config() -> AxisConfig {
        let node = NodeId::new(1).unwrap();
        let mut config = AxisConfig::new(NodeAddress { slave: 0, channel: 0, node });
        config.scale = Scale::steps_per_turn(36_000.0);
        config
    }

    fn limits(max_velocity: f64, range: &str) -> LimitArguments {
        LimitArguments { max_velocity, range: range.parse().unwrap(), acceleration: None }
    }

    fn units(config: &AxisConfig) -> AxisUnits {
        AxisUnits::new(Unit::Deg, config.scale, 0)
    }

    #[test]
    fn range_is_two_numbers_in_order() {
        assert_eq!("-90..90.5".parse(), Ok(PositionBounds { min: -90.0, max: 90.5 }));
        for wrong in ["", "1", "1..", "..1", "2..1", "1..1", "a..b", "nan..1", "0..inf"] {
            assert!(wrong.parse::<PositionBounds>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn narrower_limit_applies() {
        let mut config = config();
        let wide = limits(90.0, "-10..10").envelope(&units(&config), &config).unwrap();
        let expected =
            Envelope { velocity: 9_000.0, acceleration: 18_000.0, min: -1_000, max: 1_000 };
        assert_eq!(wide, expected);
        config.limits.velocity = Some(TAU / 36.0);
        config.limits.acceleration = Some(TAU);
        config.bounds = Some((0, 500));
        let narrow = limits(90.0, "-10..10").envelope(&units(&config), &config).unwrap();
        assert!((narrow.velocity - 1_000.0).abs() < 1e-6, "{narrow:?}");
        assert!((narrow.acceleration - 36_000.0).abs() < 1e-6, "{narrow:?}");
        assert_eq!((narrow.min, narrow.max), (0, 500));
        let error = limits(1.0, "100..200").envelope(&units(&config), &config).unwrap_err();
        assert!(error.contains("--range 100..200 deg has no position in common"), "{error}");
    }
}
