//! Units of positions, velocities and accelerations of an axis.

use std::f64::consts::TAU;
use std::fmt;

use clap::ValueEnum;
use ecan_cia402::Scale;

// Not doc comments on the values: they would double the length of every help.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Unit {
    #[default]
    Deg,
    Rad,
    Turn,
    Step,
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Deg => "deg",
            Self::Rad => "rad",
            Self::Turn => "turn",
            Self::Step => "step",
        })
    }
}

impl Unit {
    /// Units per turn; `None` for steps.
    fn per_turn(self) -> Option<f64> {
        match self {
            Self::Deg => Some(360.0),
            Self::Rad => Some(TAU),
            Self::Turn => Some(1.0),
            Self::Step => None,
        }
    }
}

/// Conversion between the unit of the command line and steps of the position counter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisUnits {
    pub unit: Unit,
    steps_per_unit: f64,
    origin: f64,
}

impl AxisUnits {
    /// The units of an axis; `origin` is the step at position 0.
    pub fn new(unit: Unit, scale: Scale, origin: i32) -> Self {
        match unit.per_turn() {
            Some(per_turn) => {
                Self { unit, steps_per_unit: scale.steps() / per_turn, origin: origin.into() }
            }
            None => Self { unit, steps_per_unit: 1.0, origin: 0.0 },
        }
    }

    /// Steps at a position.
    pub fn steps(&self, position: f64) -> f64 {
        self.origin + position * self.steps_per_unit
    }

    /// Steps of a distance, velocity or acceleration, with its sign.
    pub fn length(&self, value: f64) -> f64 {
        value * self.steps_per_unit
    }

    /// Position at a step.
    pub fn position(&self, steps: f64) -> f64 {
        (steps - self.origin) / self.steps_per_unit
    }

    /// Distance, velocity or acceleration of steps, with its sign.
    pub fn value(&self, steps: f64) -> f64 {
        steps / self.steps_per_unit
    }

    fn decimals(&self) -> usize {
        match self.unit {
            Unit::Deg => 3,
            Unit::Rad | Unit::Turn => 5,
            Unit::Step => 0,
        }
    }

    /// Number without unit, in the precision of the unit.
    pub fn number(&self, value: f64) -> String {
        let decimals = self.decimals();
        let text = format!("{value:.decimals$}");
        match text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.')) {
            true => format!("{:.decimals$}", 0.0),
            false => text,
        }
    }

    /// Text of a position given in steps: `12.500 deg`.
    pub fn position_text(&self, steps: f64) -> String {
        format!("{} {}", self.number(self.position(steps)), self.unit)
    }

    /// Text of a distance given in steps.
    pub fn length_text(&self, steps: f64) -> String {
        format!("{} {}", self.number(self.value(steps)), self.unit)
    }

    /// Text of the amount of a velocity given in steps per second: `30.000 deg/s`.
    pub fn velocity_text(&self, steps_per_second: f64) -> String {
        format!("{} {}/s", self.number(self.value(steps_per_second).abs()), self.unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_and_lengths_are_converted_with_origin_and_sign() {
        let scale = Scale::steps_per_turn(-3_600.0);
        let units = AxisUnits::new(Unit::Deg, scale, 100);
        assert_eq!((units.steps(10.0), units.length(10.0)), (0.0, -100.0));
        assert_eq!((units.position(0.0), units.value(-100.0)), (10.0, 10.0));
        assert_eq!(units.position_text(0.0), "10.000 deg");
        assert_eq!(units.velocity_text(-300.0), "30.000 deg/s");
        assert_eq!(units.number(-0.0001), "0.000", "no negative zero");
        let steps = AxisUnits::new(Unit::Step, scale, 100);
        assert_eq!((steps.steps(7.0), steps.position_text(7.0)), (7.0, "7 step".to_owned()));
        let turns = AxisUnits::new(Unit::Turn, scale, 0);
        assert_eq!(turns.steps(0.5), -1_800.0);
    }
}
