//! Limits of a motion, which have no defaults.

use std::f64::consts::TAU;
use std::str::FromStr;

use clap::Args;
use ecan_canopen::OperatingMode;
use ecan_cia402::AxisConfig;

use super::envelope::Envelope;
use super::unit::AxisUnits;

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
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|it| it.is_finite());
        let (min, max) = number(min).zip(number(max)).ok_or_else(wrong)?;
        if min < max { Ok(Self { min, max }) } else { Err(wrong()) }
    }
}

pub fn parse_number(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|it: &f64| it.is_finite());
    number.ok_or_else(|| "expected a number".to_owned())
}

pub fn parse_positive(text: &str) -> Result<f64, String> {
    parse_number(text)
        .ok()
        .filter(|it| *it > 0.0)
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
        let of_file = |limit: Option<f64>| limit.map(|it| it * per_radian);
        let velocity = units.length(self.max_velocity).abs();
        let velocity = of_file(config.limits.velocity).map_or(velocity, |it| velocity.min(it));
        let acceleration = self.acceleration.map(|it| units.length(it).abs());
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

#[cfg(test)]
mod tests {
    use super::super::unit::Unit;
    use super::*;
    use ecan_canopen::{NodeAddress, NodeId};
    use ecan_cia402::Scale;

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
