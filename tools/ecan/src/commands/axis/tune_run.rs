//! Execution of a test, with its recording.

use std::f64::consts::TAU;

use ecan_cia402::Decision;

use crate::context::{Failure, Result};

use super::axis_choice::ChosenAxis;
use super::envelope::{Envelope, velocity_factor};
use super::frequency_point::{FrequencyPoint, frequencies};
use super::position_profile::PositionProfile;
use super::session::{AXIS, AxisSession};
use super::step_response::Sample;
use super::tune_test::TuneTest;

/// Periods of a frequency that are recorded, after one that is not.
const PERIODS: f64 = 3.0;
/// Most samples: ten minutes at 1 ms.
const SAMPLES: usize = 600_000;

/// A test with its recording.
pub struct TuneRun {
    test: TuneTest,
    envelope: Envelope,
    pub samples: Vec<Sample>,
    period_s: f64,
    /// Units of the drive's velocity per step/s.
    factor: f64,
    /// Accepted targets.
    sent: u64,
    start: f64,
}

impl TuneRun {
    pub fn new(session: &AxisSession, test: &TuneTest, envelope: Envelope) -> Result<Self> {
        let period_s = session.target_period_s();
        let seconds = match test.sweep {
            Some((bounds, count)) => frequencies(bounds.min, bounds.max, count)
                .map(|hertz| (PERIODS + 1.0) / hertz)
                .sum(),
            None => {
                test.settle * 2.0
                    + 2.0 * envelope.velocity / envelope.acceleration
                    + test.size.abs() / envelope.velocity
            }
        };
        // The cast saturates.
        let space = (seconds / period_s) as usize + 1_000;
        if space > SAMPLES {
            return Err(Failure::Usage(format!(
                "the test takes {seconds:.0} s; allowed: {:.0} s; use higher frequencies or fewer points",
                SAMPLES as f64 * period_s
            )));
        }
        let config = session.cia402().config(AXIS);
        let start = match test.is_velocity {
            true => 0.0,
            false => Ok(session.cia402().target(AXIS).map(f64::from))
                .and_then(|target| target.map_or_else(|| session.actual(), Ok))?,
        };
        Ok(Self {
            test: *test,
            envelope,
            samples: Vec::with_capacity(space),
            period_s,
            factor: config.map_or(1.0, velocity_factor),
            sent: 0,
            start,
        })
    }

    pub fn execute(
        &mut self,
        session: &mut AxisSession,
        chosen: &ChosenAxis,
    ) -> Result<Vec<FrequencyPoint>> {
        session.report(format_args!("{} begins", self.test.name()));
        match (self.test.sweep, self.test.is_velocity) {
            (None, false) => self.step_position(session).map(|()| Vec::new()),
            (None, true) => self.step_velocity(session).map(|()| Vec::new()),
            (Some((bounds, count)), _) => {
                let all = frequencies(bounds.min, bounds.max, count);
                all.filter_map(|hertz| self.frequency(session, hertz, chosen).transpose()).collect()
            }
        }
    }

    /// Sends a target in steps or steps/s, and records it when it is accepted.
    fn send(&mut self, session: &mut AxisSession, target: f64) -> Result {
        loop {
            let raw = match self.test.is_velocity {
                true => target * self.factor,
                false => target,
            };
            let end = session.cycle(Some(raw.round() as i32))?;
            session.check_running()?;
            session.check_key()?;
            // Otherwise the motion continues when targets are accepted again.
            if matches!(end.decision, Decision::Target(_)) {
                break;
            }
        }
        self.sent += 1;
        let cia402 = session.cia402();
        let (actual, error) = match self.test.is_velocity {
            false => (
                cia402.actual(AXIS).map(f64::from),
                cia402.following_error(AXIS).map(|it| it as f64),
            ),
            true => {
                let velocity = cia402.inputs(AXIS).and_then(|it| it.velocity());
                let velocity = velocity.map(|it| f64::from(it) / self.factor);
                (velocity, velocity.map(|it| target - it))
            }
        };
        if let (Some(actual), true) = (actual, self.samples.len() < self.samples.capacity()) {
            let seconds = self.sent as f64 * self.period_s;
            let error = error.unwrap_or(target - actual);
            self.samples.push(Sample { seconds, target, actual, error });
        }
        Ok(())
    }

    fn hold(&mut self, session: &mut AxisSession, target: f64, seconds: f64) -> Result {
        let count = (seconds / self.period_s).ceil() as u64;
        (0..count).try_for_each(|_| self.send(session, target))
    }

    fn step_position(&mut self, session: &mut AxisSession) -> Result {
        let goal = (self.start + self.test.size).round();
        let mut profile = PositionProfile::at_rest(self.start);
        self.send(session, self.start)?;
        while !profile.is_at(goal) {
            profile = profile.toward(goal, self.envelope.profile(), self.period_s);
            self.send(session, profile.position())?;
        }
        self.hold(session, goal, self.test.settle)
    }

    fn step_velocity(&mut self, session: &mut AxisSession) -> Result {
        let change = self.envelope.acceleration * self.period_s;
        self.send(session, 0.0)?;
        let mut velocity = 0.0;
        for (goal, seconds) in [(self.test.size, self.test.settle), (0.0, self.test.settle)] {
            while velocity != goal {
                velocity += (goal - velocity).clamp(-change, change);
                self.send(session, velocity)?;
            }
            self.hold(session, goal, seconds)?;
        }
        Ok(())
    }

    /// Moves by a sine for whole periods; the first is not evaluated.
    fn frequency(
        &mut self,
        session: &mut AxisSession,
        hertz: f64,
        chosen: &ChosenAxis,
    ) -> Result<Option<FrequencyPoint>> {
        // Whole samples per period, so that the frequency is exact.
        let per_period = (1.0 / (hertz * self.period_s)).round().max(8.0);
        let hertz = 1.0 / (per_period * self.period_s);
        let amplitude = self.test.amplitude(hertz, &self.envelope);
        let begin = self.samples.len() + per_period as usize;
        let count = (per_period * (PERIODS + 1.0)) as u64;
        for nth in 1..=count {
            let angle = TAU * (nth as f64 / per_period).fract();
            let target = match self.test.is_velocity {
                true => amplitude * angle.sin(),
                false => self.start + amplitude / 2.0 * (1.0 - angle.cos()),
            };
            self.send(session, target)?;
        }
        let samples = self.samples.get(begin..).unwrap_or_default();
        let size = chosen.units.value(amplitude).abs();
        let point = FrequencyPoint::of(samples, hertz, size);
        Ok(point
            .map(|it| FrequencyPoint { max_error: chosen.units.value(it.max_error).abs(), ..it }))
    }
}
