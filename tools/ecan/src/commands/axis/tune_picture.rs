//! Picture of a step or sweep.

use std::path::Path;

use ecan_tool_support::command_line::run_info::RunInfo;
use ecan_tool_support::plot::{Heading, Mark, Series, TimeFigure, TimePanel, Tone};

use crate::context::{Failure, Result};

use super::step_response::Sample;
use super::unit::AxisUnits;

const VALUE_HEIGHT: u32 = 300;
const ERROR_HEIGHT: u32 = 190;
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
    pub fn write(&self, path: &Path, samples: &[Sample], units: &AxisUnits) -> Result {
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
            points: kept.iter().map(|it| (it.seconds, Some(of(it)))).collect(),
        };
        let largest = samples.iter().map(|it| it.error.abs()).fold(0.0, f64::max);
        let (quantity, unit, error_name) = match self.is_velocity {
            true => ("velocity", format!("{}/s", units.unit), "velocity error"),
            false => ("position", units.unit.to_string(), "following error"),
        };
        let end = samples.last().map_or(0.0, |it| it.seconds);
        let marks = self.end.iter().map(|text| Mark { seconds: end, text: text.clone() });
        let marks: Vec<_> = marks.collect();
        let values = TimePanel {
            title: quantity.to_owned(),
            y_label: format!("{quantity} [{unit}]"),
            series: vec![
                series("target", Tone::Target, &|it| value(it.target)),
                series("actual", Tone::Actual, &|it| value(it.actual)),
            ],
            marks: marks.clone(),
            has_texts: true,
            ..TimePanel::default()
        };
        let errors = TimePanel {
            title: format!(
                "{error_name}: largest {} {unit}",
                units.number(units.value(largest).abs())
            ),
            y_label: format!("error [{unit}]"),
            series: vec![series("target - actual", Tone::Difference, &|it| units.value(it.error))],
            marks,
            ..TimePanel::default()
        };
        let heading = Heading::new(&self.title)
            .with_subtitle(&self.subtitle)
            .simulated(self.is_simulated)
            .with_run(RunInfo::of_this_run("ecan", env!("CARGO_PKG_VERSION")));
        let figure = TimeFigure {
            heading,
            x_label: "time since the start [s]".to_owned(),
            panels: vec![(values, VALUE_HEIGHT), (errors, ERROR_HEIGHT)],
        };
        figure.write(path).map_err(|error| Failure::file("write", path, error))
    }
}
