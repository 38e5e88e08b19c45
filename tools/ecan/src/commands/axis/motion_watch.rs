//! Watch of the actual motion, in addition to the motion guard, which limits targets.

use thiserror::Error;

use super::envelope::{Envelope, NOISE};
use super::unit::AxisUnits;

/// Time over which a velocity is measured, in seconds.
const WINDOW: f64 = 0.05;
/// Velocity that is too fast, in maximum velocities.
const TOO_FAST: f64 = 1.5;

/// Actual motion beyond the limits.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum Exceeded {
    #[error("the actual velocity is {velocity:.0} step/s; allowed: {limit:.0} step/s")]
    Velocity { velocity: f64, limit: f64 },
    #[error("the actual position {position} is outside the range {min}..{max} step")]
    Range { position: i64, min: i64, max: i64 },
}

impl Exceeded {
    /// Text in the units of the command line.
    pub fn text(&self, units: &AxisUnits) -> String {
        match *self {
            Self::Velocity { velocity, limit } => format!(
                "the actual velocity is {}; allowed: {}",
                units.velocity_text(velocity),
                units.velocity_text(limit)
            ),
            Self::Range { position, min, max } => {
                let (min, max) = (units.position(min as f64), units.position(max as f64));
                format!(
                    "the actual position {} is outside the range {}..{}",
                    units.position_text(position as f64),
                    units.number(min.min(max)),
                    units.number(min.max(max))
                )
            }
        }
    }
}

/// Positions of an axis that is allowed to move within limits.
#[derive(Clone, Copy, Debug)]
pub struct MotionWatch {
    envelope: Envelope,
    /// Time in seconds and position at the begin of the window.
    since: Option<(f64, i64)>,
    /// Distance by which the position counter was set since the start.
    recounted: i64,
    last: Option<i64>,
}

impl MotionWatch {
    pub fn new(envelope: Envelope) -> Self {
        Self { envelope, since: None, recounted: 0, last: None }
    }

    /// Takes the position of a cycle; `may_recount` while the drive may set its position counter, at the end
    /// of homing: then a jump does not count as motion.
    pub fn observe(
        &mut self,
        seconds: f64,
        position: i32,
        may_recount: bool,
    ) -> Result<(), Exceeded> {
        let Envelope { velocity, min, max, .. } = self.envelope;
        let mut travelled = i64::from(position) - self.recounted;
        if let (Some(last), true) = (self.last, may_recount)
            && (travelled - last).unsigned_abs() as f64 > self.envelope.tolerance()
        {
            self.recounted += travelled - last;
            travelled = last;
            self.since = None;
        }
        self.last = Some(travelled);
        let tolerance = self.envelope.tolerance() as i64;
        let (min, max) = (i64::from(min), i64::from(max));
        if !(min - tolerance..=max + tolerance).contains(&travelled) {
            return Err(Exceeded::Range { position: travelled, min, max });
        }
        let Some((since, from)) = self.since else {
            self.since = Some((seconds, travelled));
            return Ok(());
        };
        let elapsed = seconds - since;
        if elapsed < WINDOW {
            return Ok(());
        }
        self.since = Some((seconds, travelled));
        let distance = (travelled - from).unsigned_abs() as f64;
        match distance > velocity * TOO_FAST * elapsed + NOISE {
            true => Err(Exceeded::Velocity { velocity: distance / elapsed, limit: velocity }),
            false => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENVELOPE: Envelope =
        Envelope { velocity: 10_000.0, acceleration: 1e5, min: -1_000, max: 1_000 };

    /// Moves with a velocity from a position; returns the error and its time in milliseconds.
    fn run(from: f64, velocity: f64, ms: u32) -> Option<(u32, Exceeded)> {
        let mut watch = MotionWatch::new(ENVELOPE);
        (0..ms).find_map(|ms| {
            let seconds = f64::from(ms) / 1_000.0;
            let position = (from + velocity * seconds) as i32;
            Some((ms, watch.observe(seconds, position, false).err()?))
        })
    }

    #[test]
    fn motion_within_the_limits_is_accepted() {
        assert_eq!(run(-1_000.0, 10_000.0, 200), None);
        assert_eq!(run(1_000.0, -10_000.0, 200), None);
    }

    #[test]
    fn fast_motion_is_found_within_two_windows() {
        let (ms, error) = run(-1_000.0, 20_000.0, 200).unwrap();
        assert!(ms <= 100, "{ms}");
        let Exceeded::Velocity { velocity, .. } = error else { panic!("{error}") };
        assert!((velocity - 20_000.0).abs() < 500.0, "{velocity}");
    }

    #[test]
    fn motion_beyond_the_range_is_found() {
        let (_, error) = run(900.0, 9_000.0, 200).unwrap();
        assert!(matches!(error, Exceeded::Range { position: 1_500..=1_540, .. }), "{error}");
    }

    #[test]
    fn counter_that_homing_sets_is_no_motion() {
        let mut watch = MotionWatch::new(ENVELOPE);
        watch.observe(0.0, 500, false).unwrap();
        watch.observe(0.001, 90_000, true).unwrap();
        watch.observe(0.1, 90_000, false).unwrap();
        watch.observe(0.2, 90_400, false).unwrap();
        assert!(watch.observe(0.3, 91_100, false).is_err(), "600 steps beyond the range");
        let mut watch = MotionWatch::new(ENVELOPE);
        watch.observe(0.0, 500, false).unwrap();
        assert!(watch.observe(0.001, 90_000, false).is_err(), "a jump without homing");
    }
}
