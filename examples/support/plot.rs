//! Target and actual position of the axes over time, as an SVG picture.

use std::error::Error;
use std::fmt::Write;
use std::path::Path;

use ecan_cia402::Cia402;

use crate::svg;

/// Maximum number of samples per axis.
const SAMPLES: u64 = 1_500;
const WIDTH: f64 = 960.0;
const PANEL: f64 = 170.0;
const LEFT: f64 = 90.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 30.0;

/// Time in seconds, target, actual position.
type Sample = (f64, Option<i32>, Option<i32>);

/// Samples of a run, drawn at its end.
#[derive(Debug)]
pub struct Plot {
    every: u64,
    axes: Vec<Vec<Sample>>,
}

impl Plot {
    /// Creates a plot for this number of axes and cycles.
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

    /// Writes the picture.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path, cia402: &Cia402) -> Result<(), Box<dyn Error>> {
        let name = |axis| cia402.settings(axis).map(|s| s.address.to_string()).unwrap_or_default();
        std::fs::write(path, self.svg(name))
            .map_err(|error| format!("cannot write {}: {error}", path.display()).into())
    }

    fn svg(&self, name: impl Fn(usize) -> String) -> String {
        let height = PANEL * self.axes.len() as f64 + 10.0;
        let mut svg = svg::open(WIDTH, height);
        for (axis, samples) in self.axes.iter().enumerate() {
            let title = format!("axis {axis}: {}", name(axis));
            panel(&mut svg, PANEL * axis as f64, &title, samples);
        }
        svg.push_str("</svg>\n");
        svg
    }
}

fn panel(svg: &mut String, top: f64, title: &str, samples: &[Sample]) {
    let end = samples.last().map_or(1.0, |last| last.0).max(1e-9);
    let values = || samples.iter().flat_map(|(_, target, actual)| [*target, *actual]).flatten();
    let (low, high) = (values().min().unwrap_or(0), values().max().unwrap_or(0));
    // A still axis gets a line in the middle.
    let (low, high) = (f64::from(low) - 1.0, f64::from(high) + 1.0);
    let (plot_width, plot_height) = (WIDTH - LEFT - RIGHT, PANEL - TOP - BOTTOM);
    let x = |seconds: f64| LEFT + plot_width * seconds / end;
    let y = |value: f64| top + TOP + plot_height * (high - value) / (high - low);
    let bottom = top + TOP + plot_height;
    // Writing to a String cannot fail.
    let _ = writeln!(
        svg,
        "<text x=\"{LEFT}\" y=\"{}\" font-weight=\"bold\">{title}</text>\n\
         <text x=\"{}\" y=\"{}\" text-anchor=\"end\"><tspan fill=\"#0b62a4\">target</tspan>  \
         <tspan fill=\"#d9542b\">actual</tspan></text>\n\
         <rect x=\"{LEFT}\" y=\"{}\" width=\"{plot_width}\" height=\"{plot_height}\" fill=\"none\" \
         stroke=\"#bbb\"/>",
        top + 18.0,
        WIDTH - RIGHT,
        top + 18.0,
        top + TOP
    );
    for (value, at) in [(high - 1.0, top + TOP + 10.0), (low + 1.0, bottom)] {
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{at}\" text-anchor=\"end\">{value:.0}</text>",
            LEFT - 6.0
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{LEFT}\" y=\"{}\">0 s</text>\n\
         <text x=\"{}\" y=\"{}\" text-anchor=\"end\">{end:.3} s</text>",
        bottom + 16.0,
        WIDTH - RIGHT,
        bottom + 16.0
    );
    let target: fn(&Sample) -> Option<i32> = |sample| sample.1;
    let actual: fn(&Sample) -> Option<i32> = |sample| sample.2;
    for (value_of, color) in [(target, "#0b62a4"), (actual, "#d9542b")] {
        let mut points = String::new();
        for sample in samples {
            if let Some(value) = value_of(sample) {
                let _ = write!(points, "{:.1},{:.1} ", x(sample.0), y(f64::from(value)));
            }
        }
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.3\"/>",
            points.trim_end()
        );
    }
}
