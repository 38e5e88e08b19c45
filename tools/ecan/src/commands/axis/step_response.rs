//! Figures of a motion that ends at a target.

use serde::Serialize;

/// A recorded cycle; values in steps, or in steps/s of velocities.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    pub seconds: f64,
    pub target: f64,
    pub actual: f64,
    /// Target minus actual value.
    pub error: f64,
}

/// Figures of a step, in the unit of its samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StepResponse {
    /// Distance beyond the last target, 0 or above.
    pub overshoot: f64,
    /// The same in percent of the step.
    pub overshoot_percent: f64,
    /// Time from the last change of the target until the actual value stays within the tolerance; `None` if it does
    /// not until the end.
    pub settling_s: Option<f64>,
    /// Largest amount of target minus actual value.
    pub max_error: f64,
    /// Root of the mean square of target minus actual value.
    pub rms_error: f64,
    /// Target minus actual value at the end, mean of the last tenth after the end of the target.
    pub steady_error: f64,
}

impl StepResponse {
    /// Figures of samples that begin at rest; `None` without a step.
    pub fn of(samples: &[Sample], tolerance: f64) -> Option<Self> {
        let (first, last) = (samples.first()?, samples.last()?);
        let goal = last.target;
        let size = goal - first.target;
        if size == 0.0 {
            return None;
        }
        let moved = samples.iter().rposition(|it| it.target != goal).map_or(0, |at| at + 1);
        let resting = samples.get(moved..)?;
        let end = resting.first()?.seconds;
        let beyond = |it: &Sample| (it.actual - goal) * size.signum();
        let overshoot = samples.iter().map(beyond).fold(0.0, f64::max);
        let is_off = |it: &Sample| (it.actual - goal).abs() > tolerance;
        let settling_s = match samples.iter().rposition(is_off) {
            None => Some(0.0),
            Some(at) => samples.get(at + 1).map(|it| (it.seconds - end).max(0.0)),
        };
        let tail = resting.get(resting.len() - resting.len().div_ceil(10)..)?;
        let squares: f64 = samples.iter().map(|it| it.error * it.error).sum();
        Some(Self {
            overshoot,
            overshoot_percent: overshoot / size.abs() * 100.0,
            settling_s,
            max_error: samples.iter().map(|it| it.error.abs()).fold(0.0, f64::max),
            rms_error: (squares / samples.len() as f64).sqrt(),
            steady_error: tail.iter().map(|it| it.error).sum::<f64>() / tail.len() as f64,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A target that jumps to 100 at 0.1 s, and an oscillator of second order.
    fn oscillator(damping: f64) -> Vec<Sample> {
        let omega: f64 = 50.0;
        let damped = omega * (1.0 - damping * damping).sqrt();
        (0..2_000)
            .map(|ms| {
                let seconds = f64::from(ms) / 1_000.0;
                let t = (seconds - 0.1).max(0.0);
                let decay = (-damping * omega * t).exp();
                let phase = damped * t;
                let rest = decay * (phase.cos() + damping * omega / damped * phase.sin());
                let target = if seconds < 0.1 { 0.0 } else { 100.0 };
                let actual = if seconds < 0.1 { 0.0 } else { 100.0 * (1.0 - rest) };
                Sample { seconds, target, actual, error: target - actual }
            })
            .collect()
    }

    #[test]
    fn overshoot_and_settling_are_those_of_theory() {
        let damping: f64 = 0.4;
        let response = StepResponse::of(&oscillator(damping), 2.0).unwrap();
        // exp(-pi d / sqrt(1 - d^2))
        let expected =
            100.0 * (-std::f64::consts::PI * damping / (1.0 - damping * damping).sqrt()).exp();
        assert!((response.overshoot_percent - expected).abs() < 0.2, "{response:?} {expected}");
        assert_eq!(response.overshoot, response.overshoot_percent);
        // The envelope is below 2 % after ln(50 / sqrt(1 - d^2)) / (d omega) = 0.2 s.
        let settling = response.settling_s.unwrap();
        assert!((0.1..0.2).contains(&settling), "{settling}");
        assert_eq!(response.max_error, 100.0);
        assert!(response.steady_error.abs() < 1e-3);
    }

    #[test]
    fn response_that_does_not_settle_has_no_time() {
        let mut samples = oscillator(0.9);
        assert!(StepResponse::of(&samples, 2.0).unwrap().settling_s.is_some());
        samples.last_mut().unwrap().actual = 90.0;
        assert_eq!(StepResponse::of(&samples, 2.0).unwrap().settling_s, None);
        assert_eq!(StepResponse::of(&samples[..50], 2.0), None, "no step yet");
        assert_eq!(StepResponse::of(&[], 2.0), None);
    }

    #[test]
    fn negative_step_overshoots_downwards() {
        let mut samples = oscillator(0.4);
        for it in &mut samples {
            (it.target, it.actual, it.error) = (-it.target, -it.actual, -it.error);
        }
        assert!(StepResponse::of(&samples, 2.0).unwrap().overshoot_percent > 20.0);
    }
}
