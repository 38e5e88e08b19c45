//! The motion of a test: size, frequencies, limits.

use std::f64::consts::{PI, TAU};
use std::time::Duration;

use crate::context::{Failure, Result};

use super::axis_choice::ChosenAxis;
use super::envelope::Envelope;
use super::limit_arguments::PositionBounds;
use super::step_response::Sample;

/// The motion of a test, in steps and seconds.
#[derive(Clone, Copy, Debug)]
pub struct TuneTest {
    pub is_velocity: bool,
    /// Size of the step, or amplitude of the sweep, with sign.
    pub size: f64,
    pub sweep: Option<(PositionBounds, u32)>,
    /// Time at the target, in seconds.
    pub settle: f64,
}

impl TuneTest {
    /// A test of this size, in the unit of the command line; `sweep`: frequencies and their number.
    pub fn of(
        is_velocity: bool,
        size: f64,
        sweep: Option<(PositionBounds, u32)>,
        settle: Duration,
        (chosen, envelope): (&ChosenAxis, &Envelope),
    ) -> Result<Self> {
        let steps = chosen.units.length(size);
        if steps.abs() < 1.0 {
            return Err(Failure::Usage(format!(
                "the size {size} {} is less than a step of the position counter; set a larger one",
                chosen.units.unit
            )));
        }
        if is_velocity && steps.abs() > envelope.velocity * (1.0 + 1e-9) {
            return Err(Failure::Usage(format!(
                "the velocity {} is out of range; allowed: up to {}",
                chosen.units.velocity_text(steps),
                chosen.units.velocity_text(envelope.velocity)
            )));
        }
        Ok(Self { is_velocity, size: steps, sweep, settle: settle.as_secs_f64() })
    }

    pub fn name(&self) -> &'static str {
        if self.sweep.is_some() { "sweep" } else { "step" }
    }

    /// Amplitude at a frequency within the limits: peak to peak of a position, peak of a velocity.
    pub fn amplitude(&self, hertz: f64, envelope: &Envelope) -> f64 {
        let omega = TAU * hertz;
        let most = match self.is_velocity {
            false => (envelope.velocity / (PI * hertz))
                .min(2.0 * envelope.acceleration / (omega * omega)),
            true => envelope.velocity.min(envelope.acceleration / omega),
        };
        self.size.abs().min(most).copysign(self.size)
    }

    /// Rejects a test that would leave the range.
    pub fn check_travel(&self, start: f64, envelope: &Envelope, chosen: &ChosenAxis) -> Result {
        let travel = match (self.is_velocity, self.sweep) {
            (false, _) => self.size,
            (true, None) => {
                self.size * self.settle + self.size * self.size.abs() / envelope.acceleration
            }
            (true, Some((bounds, _))) => {
                // Peak to peak of the position, at the lowest frequency.
                self.amplitude(bounds.min, envelope) / (PI * bounds.min)
            }
        };
        let end = start + travel;
        match envelope.contains(end) {
            true => Ok(()),
            false => Err(Failure::Usage(format!(
                "the test would move the axis to {}, outside the range; use a smaller size, another \
                 direction, or a larger --range",
                chosen.units.position_text(end)
            ))),
        }
    }

    /// Number of samples until a velocity step returns.
    pub fn end_of_step(&self, samples: &[Sample]) -> usize {
        if !self.is_velocity || self.sweep.is_some() {
            return samples.len();
        }
        samples.iter().rposition(|it| it.target == self.size).map_or(samples.len(), |at| at + 1)
    }
}
