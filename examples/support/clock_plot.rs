//! The phase error of distributed clocks over time, as an SVG picture.

use std::error::Error;
use std::fmt::Write;
use std::path::Path;

use ecan_host::ClockStatus;

use crate::svg::{self, Anchor};

/// Maximum number of samples in a picture.
const SAMPLES: u64 = 4_000;
const WIDTH: f64 = 960.0;
const PANEL: f64 = 220.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 36.0;
const BOTTOM: f64 = 34.0;
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

    /// Writes the picture.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), Box<dyn Error>> {
        std::fs::write(path, self.svg())
            .map_err(|error| format!("cannot write {}: {error}", path.display()).into())
    }

    fn svg(&self) -> String {
        let mut out = svg::open(WIDTH, 2.0 * PANEL);
        let errors = || self.samples.iter().map(|(_, us)| *us);
        let low = errors().fold(-1.0, f64::min);
        let high = errors().fold(1.0, f64::max);
        let air = (high - low) * 0.05;
        self.panel(&mut out, 0.0, "phase error", (low - air, high + air));
        self.panel(&mut out, PANEL, "phase error, enlarged", (-CLOSE_US, CLOSE_US));
        out.push_str("</svg>\n");
        out
    }

    fn panel(&self, out: &mut String, top: f64, title: &str, (low, high): (f64, f64)) {
        let end = self.samples.last().map_or(1.0, |last| last.0).max(1e-9);
        let (x0, x1) = (LEFT, WIDTH - RIGHT);
        let (y0, y1) = (top + PANEL - BOTTOM, top + TOP);
        let x = |seconds: f64| x0 + (x1 - x0) * seconds / end;
        let y = |us: f64| y0 - (y0 - y1) * (us.clamp(low, high) - low) / (high - low);
        svg::text(out, (x0, y1 - 10.0), Anchor::Start, "font-weight=\"bold\"", title);
        svg::text(out, (x1, y1 - 10.0), Anchor::End, "fill=\"#b03030\"", "| reading missed");
        // Writing to a String cannot fail.
        for us in svg::ticks(low, high, 5) {
            let _ = writeln!(
                out,
                "<line x1=\"{x0}\" x2=\"{x1}\" y1=\"{0:.1}\" y2=\"{0:.1}\" stroke=\"#e4e4e4\"/>",
                y(us)
            );
            svg::text(out, (x0 - 6.0, y(us) + 4.0), Anchor::End, "", &format!("{us} us"));
        }
        for seconds in svg::ticks(0.0, end, 8) {
            svg::text(out, (x(seconds), y0 + 18.0), Anchor::Middle, "", &format!("{seconds} s"));
        }
        let _ = writeln!(
            out,
            "<rect x=\"{x0}\" y=\"{y1}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#999\"/>",
            x1 - x0,
            y0 - y1
        );
        for seconds in &self.missed {
            let _ = writeln!(
                out,
                "<line x1=\"{0:.1}\" x2=\"{0:.1}\" y1=\"{y0}\" y2=\"{1}\" stroke=\"#b03030\"/>",
                x(*seconds),
                y0 - 8.0
            );
        }
        let points = self.samples.iter().fold(String::new(), |mut points, (seconds, us)| {
            let _ = write!(points, "{:.1},{:.1} ", x(*seconds), y(*us));
            points
        });
        let _ = writeln!(
            out,
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"#0b62a4\" stroke-width=\"1.3\"/>"
        );
    }
}
