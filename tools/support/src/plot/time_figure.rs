use std::path::Path;

use crate::plot::canvas::{self, px};
use crate::plot::heading::Heading;
use crate::plot::plot_error::PlotError;
use crate::plot::time_panel::TimePanel;

/// Diagrams of values over the same time, above each other.
#[derive(Debug, Clone, Default)]
pub struct TimeFigure {
    /// Title and circumstances.
    pub heading: Heading,
    /// Name and unit of the time: `time since the start of motion [s]`.
    pub x_label: String,
    /// Panels with their heights in pixels.
    pub panels: Vec<(TimePanel, u32)>,
}

const WIDTH: u32 = px(1_000);

impl TimeFigure {
    /// Returns the picture.
    ///
    /// # Errors
    /// [`PlotError::Draw`].
    pub fn to_svg(&self) -> Result<String, PlotError> {
        let points = || self.panels.iter().flat_map(|it| &it.0.series).flat_map(|it| &it.points);
        let start = points().map(|point| point.0).fold(f64::INFINITY, f64::min);
        let end = points().map(|point| point.0).fold(f64::NEG_INFINITY, f64::max);
        // The first sample comes a cycle after the start.
        let start = if start > 0.0 && start < end * 0.02 { 0.0 } else { start };
        let seconds = match end > start {
            true => start..end,
            // A single sample, or none.
            false if end.is_finite() => end - 0.5..end + 0.5,
            false => 0.0..1.0,
        };
        let height = self.panels.iter().map(|it| px(it.1)).sum::<u32>().max(px(1));
        canvas::picture(&self.heading, (WIDTH, height), |area| {
            let mut rest = area.clone();
            for (number, (panel, height)) in (1..).zip(&self.panels) {
                let (upper, lower) = rest.split_vertically(px(*height));
                let is_last = number == self.panels.len();
                panel.draw(&upper, seconds.clone(), is_last.then_some(self.x_label.as_str()))?;
                rest = lower;
            }
            Ok(())
        })
    }

    /// Writes the picture to a file.
    ///
    /// # Errors
    /// [`PlotError`].
    pub fn write(&self, path: &Path) -> Result<(), PlotError> {
        canvas::write(path, &self.to_svg()?)
    }
}
