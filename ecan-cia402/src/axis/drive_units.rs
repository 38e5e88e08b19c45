//! Units and limits of a drive, as it has them.

use std::fmt;

use ecan_canopen::{AngleUnit, SiUnit, Step, object};
use ecan_protocol::sequence::Expectation;

use super::units::Scale;

/// Largest relative difference of two scales that are the same: that of an `f32`.
const TOLERANCE: f64 = 1e-6;

/// Origin of [`AxisConfig::scale`](crate::AxisConfig::scale).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ScaleSource {
    /// The configuration; the units of the drive are not read.
    #[default]
    Configured,
    /// The configuration; the units of the drive are read and compared, see
    /// [`Cia402::scale_finding`](crate::Cia402::scale_finding).
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
        /// Of the configuration, with sign.
        configured: f64,
        /// Of the drive.
        drive: f64,
    },
    /// The velocity units differ.
    VelocityUnits {
        /// Of the configuration, with sign.
        configured: f64,
        /// Of the drive.
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

#[cfg(test)]
mod tests {
    use super::*;

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
