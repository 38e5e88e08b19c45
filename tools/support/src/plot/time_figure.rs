//! Diagrams of values over the same time, above each other.

use std::ops::Range;
use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use super::canvas;
use super::canvas::{
    Area, BAND, FAINT, FRAME, GREEN, GRID, Heading, LIGHT_BLUE, ORANGE, PlotError, RED, TEXT, UNIT,
    font, px, stroke, text,
};

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
        let points = || {
            self.panels.iter().flat_map(|panel| &panel.0.series).flat_map(|series| &series.points)
        };
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
        let height = self.panels.iter().map(|panel| px(panel.1)).sum::<u32>().max(px(1));
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

/// Colour of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// Light blue, broad: what was requested.
    Target,
    /// Orange: what was measured.
    Actual,
    /// Green: a difference.
    Difference,
}

impl Tone {
    /// The curve of the targets is broad, so that it is visible below that of the actual values.
    fn style(self) -> ShapeStyle {
        stroke(self.color(), if self == Self::Target { 5 } else { 2 })
    }

    fn color(self) -> RGBColor {
        match self {
            Self::Target => LIGHT_BLUE,
            Self::Actual => ORANGE,
            Self::Difference => GREEN,
        }
    }
}

/// A curve.
#[derive(Debug, Clone)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Colour.
    pub tone: Tone,
    /// Time in seconds and value; the curve is interrupted where the value is missing.
    pub points: Vec<(f64, Option<f64>)>,
}

/// A period that is marked in all panels of a figure, for example a hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// First and last time, in seconds.
    pub seconds: Range<f64>,
    /// Text.
    pub text: String,
}

/// A moment that is marked in all panels of a figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Time in seconds.
    pub seconds: f64,
    /// Text; empty for a small mark at the lower edge, as for missed readings.
    pub text: String,
}

/// A diagram of values over time.
#[derive(Debug, Clone, Default)]
pub struct TimePanel {
    /// Title.
    pub title: String,
    /// Name and unit of the values: `position [inc]`.
    pub y_label: String,
    /// Range of the values [default: that of the curves].
    pub y: Option<Range<f64>>,
    /// Least width of the range, in units of the values.
    pub least_width: f64,
    /// Curves.
    pub series: Vec<Series>,
    /// Marked periods.
    pub bands: Vec<Band>,
    /// Marked moments.
    pub marks: Vec<Mark>,
    /// Name of the marks without a text in the legend.
    pub mark_name: String,
    /// Texts of bands and marks are drawn in this panel.
    pub has_texts: bool,
}

/// Most rows of texts in a panel.
const TEXT_ROWS: usize = 6;
const TEXT_ROW: i32 = 16 * UNIT;
/// Width of a character at 13 px, in units.
const CHARACTER: f64 = 6.3 * UNIT as f64;
const Y_LABELS: u32 = px(80);
const X_LABELS: u32 = px(44);
const MARGIN: i32 = 16 * UNIT;
/// Height of the line with title and legend.
const HEAD: i32 = 26 * UNIT;

impl TimePanel {
    /// Draws the panel; only the last one of a figure labels the time.
    pub(crate) fn draw(
        &self,
        area: &Area<'_>,
        seconds: Range<f64>,
        x_label: Option<&str>,
    ) -> Result<(), PlotError> {
        let values =
            self.series.iter().flat_map(|series| &series.points).filter_map(|point| point.1);
        let y = self.y.clone().unwrap_or_else(|| canvas::range(values, self.least_width));
        let (width, height) = area.dim_in_pixel();
        let texts = self.place_texts(width as i32 - 2 * MARGIN - Y_LABELS as i32, &seconds);
        // The texts are above the curves.
        let rows = texts.iter().map(|(_, (_, row))| row + 1).max().unwrap_or(0) as f64;
        let part = (rows * f64::from(TEXT_ROW) / f64::from(height - px(70))).min(0.6);
        let y = y.start..y.end + (y.end - y.start) * part / (1.0 - part);
        let (x_width, y_width) = (seconds.end - seconds.start, y.end - y.start);
        let mut chart = ChartBuilder::on(area)
            .margin_left(MARGIN)
            .margin_right(MARGIN)
            .margin_top(HEAD)
            .margin_bottom(4 * UNIT)
            .x_label_area_size(x_label.map_or(px(22), |_| X_LABELS))
            .y_label_area_size(Y_LABELS)
            .build_cartesian_2d(seconds.clone(), y.clone())
            .map_err(PlotError::draw)?;
        chart
            .configure_mesh()
            .x_labels(11)
            .y_labels(7)
            .max_light_lines(0)
            .bold_line_style(stroke(GRID, 1))
            .axis_style(stroke(FRAME, 1))
            .set_all_tick_mark_size(px(5))
            .label_style(font(13, TEXT))
            .axis_desc_style(font(14, TEXT))
            .x_label_formatter(&|value| canvas::label(*value, x_width))
            .y_label_formatter(&|value| canvas::label(*value, y_width))
            .x_desc(x_label.unwrap_or_default())
            .y_desc(&self.y_label)
            .draw()
            .map_err(PlotError::draw)?;
        let bands = self.bands.iter().map(|band| {
            let Range { start, end } = band.seconds;
            // A short band remains visible.
            let end = end.max(start + x_width / 500.0).min(seconds.end);
            Rectangle::new([(start, y.start), (end, y.end)], BAND.mix(0.45).filled())
        });
        chart.draw_series(bands).map_err(PlotError::draw)?;
        for mark in &self.marks {
            let (top, style) = match mark.text.is_empty() {
                true => (y.start + y_width * 0.05, stroke(RED, 1)),
                false => (y.end, stroke(FAINT, 1)),
            };
            let ends = vec![(mark.seconds, y.start), (mark.seconds, top)];
            let line = std::iter::once(PathElement::new(ends, style));
            chart.draw_series(line).map_err(PlotError::draw)?;
        }
        for series in &self.series {
            let style = series.tone.style();
            for part in parts(&series.points, &y) {
                match part[..] {
                    // A single point has no line.
                    [point] => {
                        let circle = std::iter::once(Circle::new(point, 2 * UNIT, style.filled()));
                        chart.draw_series(circle).map_err(PlotError::draw)?
                    }
                    _ => {
                        chart.draw_series(LineSeries::new(part, style)).map_err(PlotError::draw)?
                    }
                };
            }
        }
        let plotting = chart.plotting_area().strip_coord_spec();
        for (content, (left, row)) in &texts {
            let position = (*left, 3 * UNIT + TEXT_ROW * *row as i32);
            text(&plotting, content, position, 13, RED, (HPos::Left, VPos::Top))?;
        }
        self.draw_head(area)
    }

    /// Draws title and legend above the diagram.
    fn draw_head(&self, area: &Area<'_>) -> Result<(), PlotError> {
        let middle = HEAD / 2;
        let left = MARGIN + Y_LABELS as i32;
        text(area, &self.title, (left, middle), 15, TEXT, (HPos::Left, VPos::Center))?;
        let mut right = area.dim_in_pixel().0 as i32 - MARGIN;
        let mut entry = |name: &str, sample: &dyn Fn(i32) -> (Vec<(i32, i32)>, ShapeStyle)| {
            text(area, name, (right, middle), 13, TEXT, (HPos::Right, VPos::Center))?;
            let end = right - (name.chars().count() as f64 * CHARACTER) as i32 - 8 * UNIT;
            let (points, style) = sample(end);
            area.draw(&PathElement::new(points, style)).map_err(PlotError::draw)?;
            right = end - 44 * UNIT;
            Ok(())
        };
        if !self.mark_name.is_empty() && self.marks.iter().any(|mark| mark.text.is_empty()) {
            let name = format!("{} ({})", self.mark_name, self.marks.len());
            let line = stroke(RED, 1);
            entry(&name, &|end| (vec![(end, middle - 5 * UNIT), (end, middle + 5 * UNIT)], line))?;
        }
        for series in self.series.iter().rev() {
            let style = series.tone.style();
            entry(&series.name, &|end| (vec![(end - 22 * UNIT, middle), (end, middle)], style))?;
        }
        Ok(())
    }

    /// Returns the texts of bands and marks with left end and row, in a diagram of this width.
    fn place_texts(&self, width: i32, seconds: &Range<f64>) -> Vec<(String, (i32, usize))> {
        if !self.has_texts {
            return Vec::new();
        }
        let units = f64::from(width) / (seconds.end - seconds.start);
        let mut texts: Vec<(f64, &str)> =
            self.bands.iter().map(|band| (band.seconds.start, band.text.as_str())).collect();
        texts.extend(self.marks.iter().map(|mark| (mark.seconds, mark.text.as_str())));
        texts.retain(|(_, text)| !text.is_empty());
        texts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut rows = LabelRows::new(width, TEXT_ROWS);
        let (mut placed, mut hidden) = (Vec::new(), 0);
        for (at, content) in texts {
            let length = (content.chars().count() as f64 * CHARACTER) as i32;
            let x = ((at - seconds.start) * units) as i32 + 3 * UNIT;
            match rows.place(x, length) {
                Some(place) => placed.push((content.to_owned(), place)),
                None => hidden += 1,
            }
        }
        if hidden > 0 {
            placed.push((format!("and {hidden} more events"), (3 * UNIT, TEXT_ROWS)));
        }
        placed
    }
}

/// Returns the uninterrupted parts of a curve, within the range of the values.
fn parts(points: &[(f64, Option<f64>)], y: &Range<f64>) -> Vec<Vec<(f64, f64)>> {
    let whole = |part: &[(f64, Option<f64>)]| -> Vec<(f64, f64)> {
        let within =
            |(at, value): &(f64, Option<f64>)| Some((*at, value.as_ref()?.clamp(y.start, y.end)));
        part.iter().filter_map(within).collect()
    };
    let parts = points.split(|(_, value)| value.is_none_or(|value| !value.is_finite()));
    parts.map(whole).filter(|part| !part.is_empty()).collect()
}

/// Rows of texts in an area of this width.
#[derive(Debug)]
pub struct LabelRows {
    width: i32,
    /// Right end of the last text of each row.
    ends: Vec<i32>,
    most: usize,
}

/// Distance between two texts of a row, in units.
const GAP: i32 = 8;

impl LabelRows {
    pub fn new(width: i32, most: usize) -> Self {
        Self { width, ends: Vec::new(), most }
    }

    /// Returns left end and row of a text of this width at `x`; to the left of `x` if there is no
    /// space to the right. `None` if no row has space. Texts come in the order of `x`.
    pub fn place(&mut self, x: i32, text_width: i32) -> Option<(i32, usize)> {
        let left = x.min(self.width - text_width).max(0);
        let free = self.ends.iter().position(|end| end + GAP <= left);
        let row = match free {
            Some(row) => row,
            None if self.ends.len() < self.most => {
                self.ends.push(0);
                self.ends.len() - 1
            }
            None => return None,
        };
        *self.ends.get_mut(row)? = left + text_width;
        Some((left, row))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curve_is_interrupted_where_a_value_is_missing() {
        let points =
            [(0.0, None), (1.0, Some(1.0)), (2.0, Some(9.0)), (3.0, None), (4.0, Some(2.0))];
        let parts = parts(&points, &(0.0..5.0));
        assert_eq!(parts, [vec![(1.0, 1.0), (2.0, 5.0)], vec![(4.0, 2.0)]]);
    }

    #[test]
    fn texts_that_would_overlap_get_another_row() {
        let mut rows = LabelRows::new(300, 2);
        assert_eq!(rows.place(0, 100), Some((0, 0)));
        assert_eq!(rows.place(50, 100), Some((50, 1)));
        assert_eq!(rows.place(60, 100), None, "both rows are taken");
        assert_eq!(rows.place(120, 100), Some((120, 0)));
        assert_eq!(rows.place(290, 100), Some((200, 1)), "moved to the left");
        assert_eq!(rows.place(290, 100), None);
    }
}
