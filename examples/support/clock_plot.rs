//! The phase error of distributed clocks over time, as an SVG picture.

use std::error::Error;
use std::path::Path;

use ecan_host::ClockStatus;

use crate::svg::{self, Diagram};

/// Maximum number of samples in a picture.
const SAMPLES: u64 = 4_000;
const WIDTH: f64 = 960.0;
const PANEL: f64 = 220.0;
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
    pub fn write(&self, path: &Path) -> Result<(), Box<dyn Error>> {
        let errors = || self.samples.iter().map(|(_, us)| *us);
        let (low, high) = (errors().fold(-1.0, f64::min), errors().fold(1.0, f64::max));
        let margin = (high - low) * 0.05;
        let picture = svg::picture(WIDTH, 2.0 * PANEL, |svg| {
            self.draw(svg, 0.0, "phase error", (low - margin, high + margin));
            self.draw(svg, PANEL, "phase error, enlarged", (-CLOSE_US, CLOSE_US));
        });
        svg::write(path, &picture)
    }

    fn draw(&self, svg: &mut String, top: f64, title: &str, y: (f64, f64)) {
        let end = self.samples.last().map_or(1.0, |last| last.0).max(1e-9);
        let rows = (top + PANEL - 34.0, top + 36.0);
        let diagram = Diagram { columns: (70.0, WIDTH - 20.0), rows, x: (0.0, end), y };
        diagram.frame(svg, title, ("| reading missed", "#b03030"));
        for us in svg::ticks(y.0, y.1, 5) {
            diagram.label_row(svg, us, &format!("{us} us"));
        }
        diagram.label_columns(svg, 8, |seconds| format!("{seconds} s"));
        for seconds in &self.missed {
            let (x, bottom) = diagram.at((*seconds, y.0));
            svg::line(svg, [(x, bottom), (x, bottom - 8.0)], "stroke=\"#b03030\"");
        }
        diagram.curve(svg, self.samples.iter().copied(), "#0b62a4");
    }
}
