//! Units and limits of the machine, and the units that a drive reports.

use std::f64::consts::PI;
use std::fmt;

use ecan_canopen::{AngleUnit, SiUnit, Step, object};
use ecan_protocol::sequence::Expectation;
use thiserror::Error;

use crate::guard::terms::PositionRange;

/// Error: a value without a raw counterpart.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum UnitError {
    /// Not a number, or infinite.
    #[error("{value} is not a position")]
    NotFinite {
        /// The value given.
        value: f64,
    },
    /// Outside the counter of the drive.
    #[error("{value} is {steps} steps, outside the drive's position counter")]
    Range {
        /// The value given, in its own unit.
        value: f64,
        /// The value in steps.
        steps: f64,
    },
}

/// Steps of the drive's position counter per turn of the axis, with sign.
///
/// A gear belongs into it: with 4096 steps per motor turn and a gear of 1:50, one turn of the
/// axis is 204800 steps. A negative scale turns the direction around.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    steps_per_turn: f64,
    origin: i32,
    velocity_units: Option<f64>,
}

impl Default for Scale {
    /// One step per degree at the drive: 360 steps per turn, origin at 0.
    fn default() -> Self {
        Self::steps_per_turn(360.0)
    }
}

impl Scale {
    /// A scale of `steps` per turn of the axis, not zero and finite (checked by
    /// [`AxisConfig::check`](super::AxisConfig::check)), with step 0 at angle 0.
    pub fn steps_per_turn(steps: f64) -> Self {
        Self { steps_per_turn: steps, origin: 0, velocity_units: None }
    }

    /// Steps per turn and the step at angle 0.
    pub(crate) fn parts(self) -> (f64, i32) {
        (self.steps_per_turn, self.origin)
    }

    pub(crate) fn of_parts((steps_per_turn, origin): (f64, i32)) -> Self {
        Self { steps_per_turn, origin, velocity_units: None }
    }

    /// Returns this scale with angle 0 at `step`.
    pub fn with_origin(self, step: i32) -> Self {
        Self { origin: step, ..self }
    }

    /// Returns this scale with the unit of the drive's target velocity: the value of 0x60FF for one turn of
    /// the axis per second. Needed for [`MotionLimits`](super::MotionLimits) in velocity modes only.
    pub fn with_velocity_units(self, per_turn_per_second: f64) -> Self {
        Self { velocity_units: Some(per_turn_per_second), ..self }
    }

    /// Units of velocity for one turn of the axis per second, if they are known.
    pub fn velocity_units(self) -> Option<f64> {
        self.velocity_units
    }

    /// Steps per turn of the axis.
    pub fn steps(self) -> f64 {
        self.steps_per_turn
    }

    /// Returns whether it can be calculated with.
    pub fn is_valid(self) -> bool {
        self.steps_per_turn.is_normal()
    }

    /// Degrees at a raw position. Real-time safe.
    pub fn degrees(self, raw: i32) -> f64 {
        self.turns(raw) * 360.0
    }

    /// Radians at a raw position. Real-time safe.
    pub fn radians(self, raw: i32) -> f64 {
        self.turns(raw) * 2.0 * PI
    }

    fn turns(self, raw: i32) -> f64 {
        (f64::from(raw) - f64::from(self.origin)) / self.steps_per_turn
    }

    /// The raw position at an angle in degrees, rounded to the nearest step. A counter that
    /// wraps takes every angle, a linear one only those within an `i32`. Real-time safe.
    ///
    /// # Errors
    /// [`UnitError`] for a value that is no position.
    pub fn from_degrees(self, degrees: f64, range: PositionRange) -> Result<i32, UnitError> {
        self.raw_at(degrees / 360.0, degrees, range)
    }

    /// The raw position at an angle in radians, as [`from_degrees`](Self::from_degrees).
    ///
    /// # Errors
    /// [`UnitError`] for a value that is no position.
    pub fn from_radians(self, radians: f64, range: PositionRange) -> Result<i32, UnitError> {
        self.raw_at(radians / (2.0 * PI), radians, range)
    }

    fn raw_at(self, turns: f64, value: f64, range: PositionRange) -> Result<i32, UnitError> {
        let steps = (turns * self.steps_per_turn).round();
        if !steps.is_finite() {
            return Err(UnitError::NotFinite { value });
        }
        let outside = UnitError::Range { value, steps };
        // Beyond 2^53 an f64 has no single steps any more: that is no position either.
        if steps.abs() > 9.0e15 {
            return Err(outside);
        }
        range.add(self.origin, steps as i64).filter(|raw| range.contains(*raw)).ok_or(outside)
    }
}

/// Largest relative difference of two scales that are the same: that of an `f32`.
const TOLERANCE: f64 = 1e-6;

/// Origin of [`AxisConfig::scale`](crate::AxisConfig::scale).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ScaleSource {
    /// The configuration; the units of the drive are not read.
    #[default]
    Configured,
    /// The configuration; the units of the drive are read and compared, see
    /// [`DriveValues::scale_finding`](crate::DriveValues::scale_finding).
    Checked,
    /// The drive: steps per turn by 0x608F, 0x6091 and 0x6092, velocity units by 0x60A9; the origin
    /// stays that of the configuration. The drive must have 0x608F. Not with
    /// [`MotionLimits`](crate::MotionLimits), which are converted before the drive is read.
    Drive,
}

/// Units of a drive, read at the end of its configuration. `None` for an object that it does not have.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DriveUnits {
    /// Encoder resolution 0x608F: increments per motor revolutions.
    pub encoder: Option<(u32, u32)>,
    /// Gear ratio 0x6091: motor revolutions per revolutions of the shaft.
    pub gear: Option<(u32, u32)>,
    /// Feed constant 0x6092: position units per revolutions of the shaft.
    pub feed: Option<(u32, u32)>,
    /// SI unit of positions 0x60A8.
    pub position: Option<SiUnit>,
    /// SI unit of velocities 0x60A9.
    pub velocity: Option<SiUnit>,
}

/// A ratio of two numbers that are not 0.
fn ratio(pair: Option<(u32, u32)>) -> Option<f64> {
    let (numerator, denominator) = pair?;
    (numerator > 0 && denominator > 0).then(|| f64::from(numerator) / f64::from(denominator))
}

impl DriveUnits {
    /// The steps that read the objects. With `is_needed` the drive must have the encoder resolution.
    pub(crate) fn steps(is_needed: bool) -> impl Iterator<Item = Step> {
        let encoder = [1, 2].map(|subindex| {
            let at_least = Expectation::AtLeast(1);
            let step = Step::expect_that(object::ENCODER_RESOLUTION, subindex, at_least);
            is_needed.then(|| step.named("encoder resolution"))
        });
        let objects = [
            (object::ENCODER_RESOLUTION, 1),
            (object::ENCODER_RESOLUTION, 2),
            (object::GEAR_RATIO, 1),
            (object::GEAR_RATIO, 2),
            (object::FEED_CONSTANT, 1),
            (object::FEED_CONSTANT, 2),
            (object::SI_UNIT_POSITION, 0),
            (object::SI_UNIT_VELOCITY, 0),
        ];
        let read = |(index, subindex)| Step::read(index, subindex).named("units").if_accepted();
        encoder.into_iter().flatten().chain(objects.map(read))
    }

    pub(crate) fn from_values(value: impl Fn(u16, u8) -> Option<u64>) -> Self {
        let number = |index, subindex| u32::try_from(value(index, subindex)?).ok();
        let pair = |index| Some((number(index, 1)?, number(index, 2)?));
        Self {
            encoder: pair(object::ENCODER_RESOLUTION),
            gear: pair(object::GEAR_RATIO),
            feed: pair(object::FEED_CONSTANT),
            position: number(object::SI_UNIT_POSITION, 0).map(SiUnit),
            velocity: number(object::SI_UNIT_VELOCITY, 0).map(SiUnit),
        }
    }

    /// Position units per revolution of the shaft: the feed constant, or without one the encoder
    /// resolution times the gear ratio. `None` if a needed object is missing or 0.
    pub fn steps_per_turn(&self) -> Option<f64> {
        if self.feed.is_some() {
            return ratio(self.feed);
        }
        Some(ratio(self.encoder)? * self.gear_ratio()?)
    }

    /// Motor revolutions per revolution of the shaft; 1 without a gear ratio.
    fn gear_ratio(&self) -> Option<f64> {
        if self.gear.is_some() { ratio(self.gear) } else { Some(1.0) }
    }

    /// Position units per revolution of the motor.
    pub fn steps_per_motor_turn(&self) -> Option<f64> {
        Some(self.steps_per_turn()? / self.gear_ratio()?)
    }

    /// Units of velocity for one revolution of the shaft per second, as
    /// [`Scale::with_velocity_units`] takes them.
    pub fn velocity_units(&self) -> Option<f64> {
        let unit = self.velocity?;
        let seconds = unit.seconds()?;
        let per_turn = match unit.angle()? {
            AngleUnit::Increment => self.steps_per_turn()?,
            AngleUnit::PerRevolution(units) => units,
        };
        Some(per_turn * seconds)
    }

    /// The scale of the drive, with the origin of another one.
    pub fn scale(&self, origin: i32) -> Option<Scale> {
        let scale = Scale::steps_per_turn(self.steps_per_turn()?).with_origin(origin);
        Some(match self.velocity_units() {
            Some(units) => scale.with_velocity_units(units),
            None => scale,
        })
    }
}

/// Difference between the configured scale of an axis and the units of its drive.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum ScaleFinding {
    /// The drive has no units by which the scale can be compared.
    Unavailable,
    /// The steps per turn differ.
    StepsPerTurn {
        /// Value of the configuration, with sign.
        configured: f64,
        /// Value of the drive.
        drive: f64,
    },
    /// The velocity units differ.
    VelocityUnits {
        /// Value of the configuration, with sign.
        configured: f64,
        /// Value of the drive.
        drive: f64,
    },
}

impl fmt::Display for ScaleFinding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unavailable => f.write_str(
                "the drive has no units (0x608F, 0x6091, 0x6092) to compare the scale with",
            ),
            Self::StepsPerTurn { configured, drive } => {
                write!(f, "steps_per_turn is {configured}, the drive has {drive}")
            }
            Self::VelocityUnits { configured, drive } => {
                write!(f, "velocity units are {configured} per turn/s, the drive has {drive}")
            }
        }
    }
}

impl ScaleFinding {
    /// Compares a scale with the units of a drive; the sign of the scale is that of the machine.
    pub(crate) fn of(scale: Scale, units: &DriveUnits) -> Option<Self> {
        let differs = |configured: f64, drive: f64| {
            (configured.abs() - drive).abs() > TOLERANCE * drive.abs()
        };
        let Some(drive) = units.steps_per_turn() else { return Some(Self::Unavailable) };
        if differs(scale.steps(), drive) {
            return Some(Self::StepsPerTurn { configured: scale.steps(), drive });
        }
        let (configured, drive) = scale.velocity_units().zip(units.velocity_units())?;
        differs(configured, drive).then_some(Self::VelocityUnits { configured, drive })
    }
}

/// Limits of an axis in units of its machine: of the axis, after the gear, by
/// [`AxisConfig::scale`](crate::AxisConfig::scale). A limit that is set replaces a value in increments, see the table;
/// `None` keeps that value.
///
/// | limit | CSP, IP | CSV | PV |
/// | --- | --- | --- | --- |
/// | `velocity` | replaces `step_limit` | narrows `bounds` | narrows `bounds` |
/// | `acceleration` | replaces `ramp` | replaces `step_limit` | fault |
/// | `jerk` | of `ramp` | of the halt | fault |
///
/// In CSV and PV the targets are velocities in units of the drive: a limit needs
/// [`Scale::with_velocity_units`](crate::Scale::with_velocity_units). In PP, CST, PT and VL every limit is a fault: the drive generates the
/// motion by its own objects, or the unit is unknown. The limits are those of
/// [`AxisConfig::mode`](crate::AxisConfig::mode); after a change of the mode to PP or PV the velocities and accelerations of
/// the motion are the drive's own.
///
/// # Application and host
///
/// The velocity limit applies to every target: the motion guard rejects one that exceeds it, in CSV
/// also one that exceeds the acceleration limit. Jerk, and in CSP acceleration, shape the motion that
/// the host makes: [`halt`](crate::AxisHandle::halt), [`stop_together`](crate::Cia402::stop_together),
/// shutdown and [`send_target_step`](crate::Cia402::send_target_step). They never reject a position
/// target of the application: a drive that gets no target stops at once, which is a larger
/// deceleration than the one that was rejected.
///
/// A stop of the host takes velocity / acceleration + acceleration / jerk; a shutdown switches the
/// drive off after five seconds, also if it is not at rest by then. Where nothing can be sent (a hold),
/// no limit shapes the stop: a drive in CSP stops by its own rules.
///
/// # Conversion
///
/// [`Cia402::new`](crate::Cia402::new) converts by the target period ([`Cia402::target_period`](crate::Cia402::target_period)),
/// and rounds down: the velocity to whole increments (or units of velocity) per period, acceleration
/// and jerk in CSP to 2^-32 increments. A limit that is less than that unit is a fault. With a velocity
/// limit, following-error window and standstill window follow as by [`AxisConfig::with_step_limit`](crate::AxisConfig::with_step_limit).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotionLimits {
    /// Largest velocity in rad/s, of both directions.
    pub velocity: Option<f64>,
    /// Largest acceleration and deceleration in rad/s^2.
    pub acceleration: Option<f64>,
    /// Largest jerk in rad/s^3; `None` does not limit it.
    pub jerk: Option<f64>,
}

/// One of the [`MotionLimits`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotionLimit {
    /// Velocity in rad/s.
    Velocity,
    /// Acceleration in rad/s^2.
    Acceleration,
    /// Jerk in rad/s^3.
    Jerk,
}

impl MotionLimit {
    /// Unit of its values.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Velocity => "rad/s",
            Self::Acceleration => "rad/s^2",
            Self::Jerk => "rad/s^3",
        }
    }
}

impl fmt::Display for MotionLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Velocity => "velocity limit",
            Self::Acceleration => "acceleration limit",
            Self::Jerk => "jerk limit",
        })
    }
}

impl MotionLimits {
    /// The limits that are set.
    pub fn iter(&self) -> impl Iterator<Item = (MotionLimit, f64)> {
        [
            (MotionLimit::Velocity, self.velocity),
            (MotionLimit::Acceleration, self.acceleration),
            (MotionLimit::Jerk, self.jerk),
        ]
        .into_iter()
        .filter_map(|(limit, value)| Some((limit, value?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LINEAR: PositionRange = PositionRange::Linear;

    #[test]
    fn quarter_turn_is_a_quarter_of_the_steps() {
        let scale = Scale::steps_per_turn(204_800.0);
        assert_eq!(scale.from_degrees(90.0, LINEAR), Ok(51_200));
        assert_eq!(scale.from_radians(PI / 2.0, LINEAR), Ok(51_200));
        assert_eq!(scale.degrees(-51_200), -90.0);
        assert_eq!(Scale::steps_per_turn(-360.0).from_degrees(90.0, LINEAR), Ok(-90));
        assert_eq!(scale.with_origin(1000).degrees(1000), 0.0);
        assert_eq!(scale.with_origin(1000).from_degrees(90.0, LINEAR), Ok(52_200));
    }

    #[test]
    fn invalid_position_is_rejected() {
        let scale = Scale::steps_per_turn(1e9);
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(matches!(scale.from_degrees(value, LINEAR), Err(UnitError::NotFinite { .. })));
        }
        assert!(matches!(scale.from_degrees(1080.0, LINEAR), Err(UnitError::Range { .. })));
        assert_eq!(scale.from_degrees(720.0, LINEAR), Ok(2_000_000_000));
        let text = scale.from_degrees(1080.0, LINEAR).unwrap_err().to_string();
        assert!(text.contains("3000000000 steps"), "{text}");
    }

    #[test]
    fn wrapping_counter_accepts_every_angle() {
        let scale = Scale::steps_per_turn(1e9);
        let wrapped = scale.from_degrees(1080.0, PositionRange::Wrapping);
        assert_eq!(wrapped, Ok((3_000_000_000_i64 - (1_i64 << 32)) as i32));
        let turn = PositionRange::Modulo { min: 0, max: 359 };
        assert_eq!(Scale::default().from_degrees(-10.0, turn), Ok(350));
    }

    proptest! {
        #[test]
        fn conversion_is_reversible(raw: i32, steps in 1.0_f64..1e6, origin in -1000..1000) {
            let scale = Scale::steps_per_turn(steps).with_origin(origin);
            let back = scale.from_degrees(scale.degrees(raw), LINEAR);
            prop_assert_eq!(back, Ok(raw));
        }
    }

    #[test]
    fn scale_follows_from_gear_and_feed() {
        let mut units =
            DriveUnits { encoder: Some((4_096, 1)), gear: Some((50, 1)), ..DriveUnits::default() };
        assert_eq!(units.steps_per_turn(), Some(204_800.0));
        assert_eq!(units.steps_per_motor_turn(), Some(4_096.0));
        assert_eq!(units.velocity_units(), None);
        units.velocity = Some(SiUnit(0x00B5_0300));
        assert_eq!(units.velocity_units(), Some(204_800.0));
        units.velocity = Some(SiUnit(0x00B4_4700));
        assert_eq!(units.velocity_units(), Some(60.0));
        units.feed = Some((360_000, 1));
        assert_eq!(units.steps_per_turn(), Some(360_000.0));
        assert_eq!(units.steps_per_motor_turn(), Some(7_200.0));
        units.feed = Some((0, 1));
        assert_eq!(units.scale(0), None);
    }

    #[test]
    fn different_scale_is_found() {
        let units = DriveUnits {
            feed: Some((65_536, 1)),
            velocity: Some(SiUnit(0x00B5_0300)),
            ..DriveUnits::default()
        };
        let finding = |scale| ScaleFinding::of(scale, &units);
        assert_eq!(finding(Scale::steps_per_turn(-65_536.0)), None);
        let wrong = finding(Scale::steps_per_turn(65_500.0)).unwrap();
        assert_eq!(wrong.to_string(), "steps_per_turn is 65500, the drive has 65536");
        let scale = Scale::steps_per_turn(65_536.0).with_velocity_units(60.0);
        let wrong = finding(scale).unwrap();
        assert_eq!(wrong.to_string(), "velocity units are 60 per turn/s, the drive has 65536");
        let none = ScaleFinding::of(scale, &DriveUnits::default());
        assert_eq!(none, Some(ScaleFinding::Unavailable));
    }
}
