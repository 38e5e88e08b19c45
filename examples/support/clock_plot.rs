//! The phase error of distributed clocks over time, as an SVG picture.

use std::ops::Range;
use std::path::Path;

use ecan_host::ClockStatus;
use ecan_tool_support::plot::{
    AxisKind, CurveFigure, CurvePanel, CurveStack, Heading, Mark, PlotError, Series, Tone,
};

/// Maximum number of samples in a picture.
const SAMPLES: u64 = 4_000;
const PANEL: u32 = 270;
/// Range of the lower panel in both directions, us.
const CLOSE_US: f64 = 1.5;

/// Time in seconds, phase error in microseconds.
type Sample = (f64, f64);

/// Samples of a run, drawn at its end.
#[derive(Debug)]
pub struct ClockPlot {
    every: u64,
    samples: Vec<Sample>,
    /// Times in seconds at which readings were missed.
    missed: Vec<f64>,
    missed_readings: u64,
    /// Largest phase error since the last sample, so that no peak is lost.
    peak: Option<Sample>,
}

impl ClockPlot {
    /// Creates a plot for this number of cycles.
    pub fn new(cycles: u64) -> Self {
        let every = cycles.div_ceil(SAMPLES).max(1);
        let samples = usize::try_from(cycles / every + 1).unwrap_or(0);
        Self {
            every,
            samples: Vec::with_capacity(samples),
            missed: Vec::with_capacity(samples),
            missed_readings: 0,
            peak: None,
        }
    }

    /// Adds the status of a cycle. Allocates only for more missed readings than samples.
    pub fn sample(&mut self, cycle: u64, seconds: f64, status: ClockStatus) {
        let missed = status.missed_readings;
        if missed > self.missed_readings {
            self.missed_readings = missed;
            self.missed.push(seconds);
        } else if let Some(ns) = status.phase_error_ns {
            let sample = (seconds, f64::from(ns) / 1e3);
            let is_larger = self.peak.is_none_or(|peak| peak.1.abs() <= sample.1.abs());
            self.peak = if is_larger { Some(sample) } else { self.peak };
        }
        if cycle.is_multiple_of(self.every) {
            self.samples.extend(self.peak.take());
        }
    }

    /// Writes the picture: all samples, and an enlarged part around 0.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path, heading: Heading) -> Result<(), PlotError> {
        let whole = self.panel("phase error", None);
        let enlarged = self.panel("phase error, enlarged", Some(-CLOSE_US..CLOSE_US));
        let stack = CurveStack {
            x_label: "time since the first cycle [s]".to_owned(),
            x_kind: AxisKind::Linear,
            panels: vec![(whole, PANEL), (enlarged, PANEL)],
        };
        CurveFigure { heading, stacks: vec![stack] }.write(path)
    }

    fn panel(&self, title: &str, y: Option<Range<f64>>) -> CurvePanel {
        let phase_error = Series {
            name: "phase error".to_owned(),
            tone: Tone::Difference,
            points: self.samples.iter().map(|(seconds, us)| (*seconds, Some(*us))).collect(),
        };
        let missed =
            |seconds: &f64| Mark { seconds: *seconds, text: String::new(), is_fault: false };
        CurvePanel {
            title: title.to_owned(),
            y_label: "phase error [us]".to_owned(),
            y,
            least_width: 2.0,
            series: vec![phase_error],
            marks: self.missed.iter().map(missed).collect(),
            mark_name: "reading missed".to_owned(),
            ..CurvePanel::default()
        }
    }
}
