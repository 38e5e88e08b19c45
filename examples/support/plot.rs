//! Target and actual position of the axes over time, as an SVG picture.

use std::error::Error;
use std::path::Path;

use ecan_cia402::Cia402;

use crate::svg::{self, Diagram};

/// Maximum number of samples per axis.
const SAMPLES: u64 = 1_500;
const WIDTH: f64 = 960.0;
const PANEL: f64 = 170.0;

/// Time in seconds, target, actual position.
type Sample = (f64, Option<i32>, Option<i32>);

/// Samples of a run, drawn at its end.
#[derive(Debug)]
pub struct Plot {
    every: u64,
    axes: Vec<Vec<Sample>>,
}

impl Plot {
    pub fn new(axes: usize, cycles: u64) -> Self {
        let every = cycles.div_ceil(SAMPLES).max(1);
        let samples = usize::try_from(cycles / every + 1).unwrap_or(0);
        Self { every, axes: vec![Vec::with_capacity(samples); axes] }
    }

    /// Adds the positions of a cycle, if it is one of the samples.
    pub fn sample(&mut self, seconds: f64, cycle: u64, cia402: &Cia402) {
        if cycle.is_multiple_of(self.every) {
            for (axis, samples) in self.axes.iter_mut().enumerate() {
                samples.push((seconds, cia402.target(axis), cia402.actual(axis)));
            }
        }
    }

    pub fn write(&self, path: &Path, cia402: &Cia402) -> Result<(), Box<dyn Error>> {
        let picture = svg::picture(WIDTH, PANEL * self.axes.len() as f64 + 10.0, |svg| {
            for (axis, samples) in self.axes.iter().enumerate() {
                let address = cia402.config(axis).map(|axis| axis.address.to_string());
                let title = format!("axis {axis}: {}", address.unwrap_or_default());
                draw(svg, PANEL * axis as f64, &title, samples);
            }
        });
        svg::write(path, &picture)
    }
}

fn draw(svg: &mut String, top: f64, title: &str, samples: &[Sample]) {
    let end = samples.last().map_or(1.0, |last| last.0).max(1e-9);
    let values = || samples.iter().flat_map(|(_, target, actual)| [*target, *actual]).flatten();
    let (low, high) = (values().min().unwrap_or(0), values().max().unwrap_or(0));
    let diagram = Diagram {
        columns: (90.0, WIDTH - 20.0),
        rows: (top + PANEL - 30.0, top + 30.0),
        x: (0.0, end),
        // An axis at rest gets a line in the middle.
        y: (f64::from(low) - 1.0, f64::from(high) + 1.0),
    };
    diagram.frame(svg, title, ("blue: target, red: actual", "#555"));
    for value in [low, high] {
        diagram.label_row(svg, value.into(), &value.to_string());
    }
    diagram.label_columns(svg, 8, |seconds| format!("{seconds} s"));
    let position = |sample: &Sample, value: Option<i32>| Some((sample.0, f64::from(value?)));
    diagram.curve(svg, samples.iter().filter_map(|s| position(s, s.1)), "#0b62a4");
    diagram.curve(svg, samples.iter().filter_map(|s| position(s, s.2)), "#d9542b");
}
