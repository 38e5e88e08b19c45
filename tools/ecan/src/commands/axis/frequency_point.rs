//! Response of an axis to a sine.

use std::f64::consts::TAU;

use serde::Serialize;

use super::step_response::Sample;

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
        let (target, actual) = (component(|it| it.target), component(|it| it.actual));
        let size = |(real, imaginary): (f64, f64)| real.hypot(imaginary);
        if size(target) == 0.0 {
            return None;
        }
        let angle = |(real, imaginary): (f64, f64)| imaginary.atan2(real).to_degrees();
        let phase = (angle(actual) - angle(target) + 180.0).rem_euclid(360.0) - 180.0;
        let max_error = samples.iter().map(|it| it.error.abs()).fold(0.0, f64::max);
        let gain = size(actual) / size(target);
        Some(Self { hertz, amplitude, gain, phase_deg: phase, max_error })
    }
}

/// Frequencies of a sweep: `count` from first to last, equally spaced by their ratio.
pub fn frequencies(first: f64, last: f64, count: u32) -> impl Iterator<Item = f64> {
    let ratio = if count > 1 { (last / first).powf(1.0 / f64::from(count - 1)) } else { 1.0 };
    (0..count).map(move |nth| first * ratio.powi(nth as i32))
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn frequencies_have_a_constant_ratio() {
        let all: Vec<_> = frequencies(1.0, 16.0, 5).collect();
        assert!(all.iter().zip([1.0, 2.0, 4.0, 8.0, 16.0]).all(|(a, b)| (a - b).abs() < 1e-9));
        assert_eq!(frequencies(3.0, 9.0, 1).collect::<Vec<_>>(), [3.0]);
    }
}
