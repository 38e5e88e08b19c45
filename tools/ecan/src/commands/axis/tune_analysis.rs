//! Step response and frequency response of a recorded test, and their picture.

use std::f64::consts::TAU;
use std::path::Path;

use ecan_tool_support::command_line::run_info::RunInfo;
use ecan_tool_support::plot::{
    AxisKind, CurveFigure, CurvePanel, CurveStack, Heading, Mark, PlotError, Series, Tone,
};
use serde::Serialize;

use super::unit::AxisUnits;
use crate::context::{Failure, Result};

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
        let moved = samples.iter().rposition(|sample| sample.target != goal).map_or(0, |at| at + 1);
        let resting = samples.get(moved..)?;
        let end = resting.first()?.seconds;
        let beyond = |sample: &Sample| (sample.actual - goal) * size.signum();
        let overshoot = samples.iter().map(beyond).fold(0.0, f64::max);
        let is_off = |sample: &Sample| (sample.actual - goal).abs() > tolerance;
        let settling_s = match samples.iter().rposition(is_off) {
            None => Some(0.0),
            Some(at) => samples.get(at + 1).map(|sample| (sample.seconds - end).max(0.0)),
        };
        let tail = resting.get(resting.len() - resting.len().div_ceil(10)..)?;
        let squares: f64 = samples.iter().map(|sample| sample.error * sample.error).sum();
        Some(Self {
            overshoot,
            overshoot_percent: overshoot / size.abs() * 100.0,
            settling_s,
            max_error: samples.iter().map(|sample| sample.error.abs()).fold(0.0, f64::max),
            rms_error: (squares / samples.len() as f64).sqrt(),
            steady_error: tail.iter().map(|sample| sample.error).sum::<f64>() / tail.len() as f64,
        })
    }
}

/// Amplitude and delay of the actual value at a frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FrequencyPoint {
    pub hertz: f64,
    /// Peak to peak of the target, in the unit of the command line.
    pub amplitude: f64,
    /// Amplitude of the actual value by that of the target.
    pub gain: f64,
    /// Phase of the actual value relative to the target, -180 to 180 degrees; it includes the delay of the
    /// communication.
    pub phase_deg: f64,
    /// Largest amount of target minus actual value.
    pub max_error: f64,
}

impl FrequencyPoint {
    /// Evaluates samples of whole periods; `None` if the target does not move.
    pub fn of(samples: &[Sample], hertz: f64, amplitude: f64) -> Option<Self> {
        let component = |value: fn(&Sample) -> f64| {
            samples.iter().fold((0.0, 0.0), |(real, imaginary), sample| {
                let angle = TAU * hertz * sample.seconds;
                (real + value(sample) * angle.cos(), imaginary - value(sample) * angle.sin())
            })
        };
        let (target, actual) =
            (component(|sample| sample.target), component(|sample| sample.actual));
        let size = |(real, imaginary): (f64, f64)| real.hypot(imaginary);
        if size(target) == 0.0 {
            return None;
        }
        let angle = |(real, imaginary): (f64, f64)| imaginary.atan2(real).to_degrees();
        let phase = (angle(actual) - angle(target) + 180.0).rem_euclid(360.0) - 180.0;
        let max_error = samples.iter().map(|sample| sample.error.abs()).fold(0.0, f64::max);
        let gain = size(actual) / size(target);
        Some(Self { hertz, amplitude, gain, phase_deg: phase, max_error })
    }
}

impl FrequencyPoint {
    /// Gain in decibels, to a hundredth; a gain near 1 has no sign of a zero.
    pub fn gain_db(&self) -> f64 {
        (2_000.0 * self.gain.log10()).round() / 100.0 + 0.0
    }
}

/// Frequencies of a sweep: `count` from first to last, equally spaced by their ratio.
pub fn frequencies(first: f64, last: f64, count: u32) -> impl Iterator<Item = f64> {
    let ratio = if count > 1 { (last / first).powf(1.0 / f64::from(count - 1)) } else { 1.0 };
    (0..count).map(move |nth| first * ratio.powi(nth as i32))
}

const VALUE_HEIGHT: u32 = 300;
const ERROR_HEIGHT: u32 = 190;
const RESPONSE_HEIGHT: u32 = 210;
/// Most points of a curve.
const POINTS: usize = 4_000;

/// Texts of a picture.
#[derive(Clone, Debug)]
pub struct TunePicture {
    pub title: String,
    pub subtitle: String,
    /// Samples are velocities or positions.
    pub is_velocity: bool,
    pub is_simulated: bool,
    /// End of a motion that was not completed.
    pub end: Option<String>,
}

impl TunePicture {
    /// Writes the points of a sweep over the frequency, and below them the samples over the time.
    pub fn write(
        &self,
        path: &Path,
        (samples, points): (&[Sample], &[FrequencyPoint]),
        units: &AxisUnits,
    ) -> Result {
        let value = |steps: f64| match self.is_velocity {
            true => units.value(steps),
            false => units.position(steps),
        };
        let every = samples.len().div_ceil(POINTS).max(1);
        // The sample with the largest error of each interval, so that no peak is lost.
        let kept: Vec<Sample> = samples
            .chunks(every)
            .filter_map(|part| {
                part.iter().copied().max_by(|a, b| a.error.abs().total_cmp(&b.error.abs()))
            })
            .collect();
        let series = |name: &str, tone, of: &dyn Fn(&Sample) -> f64| Series {
            name: name.to_owned(),
            tone,
            points: kept.iter().map(|sample| (sample.seconds, Some(of(sample)))).collect(),
        };
        let largest = samples.iter().map(|sample| sample.error.abs()).fold(0.0, f64::max);
        let (quantity, unit, error_name) = match self.is_velocity {
            true => ("velocity", format!("{}/s", units.unit), "velocity error"),
            false => ("position", units.unit.to_string(), "following error"),
        };
        let end = samples.last().map_or(0.0, |sample| sample.seconds);
        let marks =
            self.end.iter().map(|text| Mark { seconds: end, text: text.clone(), is_fault: true });
        let marks: Vec<_> = marks.collect();
        let values = CurvePanel {
            title: quantity.to_owned(),
            y_label: format!("{quantity} [{unit}]"),
            series: vec![
                series("target", Tone::Target, &|sample| value(sample.target)),
                series("actual", Tone::Actual, &|sample| value(sample.actual)),
            ],
            marks: marks.clone(),
            has_texts: true,
            ..CurvePanel::default()
        };
        let errors = CurvePanel {
            title: format!(
                "{error_name}: largest {} {unit}",
                units.number(units.value(largest).abs())
            ),
            y_label: format!("error [{unit}]"),
            series: vec![series("target - actual", Tone::Difference, &|sample| {
                units.value(sample.error)
            })],
            marks,
            ..CurvePanel::default()
        };
        let heading = Heading::new(&self.title)
            .with_subtitle(&self.subtitle)
            .simulated(self.is_simulated)
            .with_run(RunInfo::of_this_run("ecan", env!("CARGO_PKG_VERSION")));
        let mut stacks: Vec<_> = frequency_response(points).into_iter().collect();
        stacks.push(CurveStack {
            x_label: "time since the start [s]".to_owned(),
            x_kind: AxisKind::Linear,
            panels: vec![(values, VALUE_HEIGHT), (errors, ERROR_HEIGHT)],
        });
        let figure = CurveFigure { heading, stacks };
        figure.write(path).map_err(|error| plot_failure(path, error))
    }
}

/// Returns the failure of a picture.
pub fn plot_failure(path: &Path, error: PlotError) -> Failure {
    match error {
        PlotError::Write { source, .. } => Failure::file("write", path, source),
        other => Failure::file("write", path, other),
    }
}

/// Returns gain and phase over the frequency; nothing without a point.
fn frequency_response(points: &[FrequencyPoint]) -> Option<CurveStack> {
    if points.is_empty() {
        return None;
    }
    let mut phase: Vec<(f64, Option<f64>)> = Vec::new();
    for point in points {
        // The phase continues beyond -180 degrees instead of jumping to 180.
        let before = phase.last().and_then(|last| last.1).unwrap_or(0.0);
        let turns = ((before - point.phase_deg) / 360.0).round();
        phase.push((point.hertz, Some(point.phase_deg + 360.0 * turns)));
    }
    let panel = |title: &str, y_label: &str, least_width, points| CurvePanel {
        title: title.to_owned(),
        y_label: y_label.to_owned(),
        least_width,
        series: vec![Series { name: "actual / target".to_owned(), tone: Tone::Actual, points }],
        ..CurvePanel::default()
    };
    let gain = points.iter().map(|point| (point.hertz, Some(point.gain_db()))).collect();
    Some(CurveStack {
        x_label: "frequency [Hz]".to_owned(),
        x_kind: AxisKind::Logarithmic,
        panels: vec![
            (panel("gain", "gain [dB]", 2.0, gain), RESPONSE_HEIGHT),
            (panel("phase", "phase [deg]", 10.0, phase), RESPONSE_HEIGHT),
        ],
    })
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

    #[test]
    fn gain_and_phase_are_found_beside_offset_and_ramp() {
        let hertz = 5.0;
        let sample = |ms: i32| {
            let seconds = f64::from(ms) / 1_000.0;
            let target = 500.0 - 50.0 * (TAU * hertz * seconds).cos();
            let actual = 480.0 - 40.0 * (TAU * hertz * seconds - TAU / 12.0).cos();
            Sample { seconds, target, actual, error: target - actual }
        };
        let samples: Vec<_> = (200..800).map(sample).collect();
        let point = FrequencyPoint::of(&samples, hertz, 100.0).unwrap();
        assert!((point.gain - 0.8).abs() < 1e-9, "{point:?}");
        assert!((point.phase_deg + 30.0).abs() < 1e-6, "{point:?}");
        assert_eq!(FrequencyPoint::of(&[], hertz, 1.0), None);
    }

    #[test]
    fn frequency_response_has_decibels_and_a_continuous_phase() {
        let point = |hertz, gain, phase_deg| FrequencyPoint {
            hertz,
            amplitude: 1.0,
            gain,
            phase_deg,
            max_error: 0.0,
        };
        let points = [point(1.0, 1.0, -10.0), point(10.0, 0.1, -170.0), point(20.0, 0.0, 160.0)];
        let stack = frequency_response(&points).unwrap();
        assert_eq!(stack.x_kind, AxisKind::Logarithmic);
        let values = |panel: usize| -> Vec<f64> {
            stack.panels[panel].0.series[0].points.iter().filter_map(|point| point.1).collect()
        };
        assert_eq!(values(0), [0.0, -20.0, f64::NEG_INFINITY]);
        assert_eq!(values(1), [-10.0, -170.0, -200.0]);
        assert!(frequency_response(&[]).is_none());
    }

    #[test]
    fn frequencies_have_a_constant_ratio() {
        let all: Vec<_> = frequencies(1.0, 16.0, 5).collect();
        assert!(all.iter().zip([1.0, 2.0, 4.0, 8.0, 16.0]).all(|(a, b)| (a - b).abs() < 1e-9));
        assert_eq!(frequencies(3.0, 9.0, 1).collect::<Vec<_>>(), [3.0]);
    }
}
