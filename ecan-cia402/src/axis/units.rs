//! Encoder steps, radians and degrees.

use std::f64::consts::PI;

use thiserror::Error;

use crate::guard::position_range::PositionRange;

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

    /// The same scale with angle 0 at `step`.
    pub fn with_origin(self, step: i32) -> Self {
        Self { origin: step, ..self }
    }

    /// The same scale with the unit of the drive's target velocity: the value of 0x60FF for one turn of
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
}
