//! Histograms of times, one above the other.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use super::canvas;
use super::canvas::{
    Area, AxisKind, BLUE, FAINT, FRAME, GRID, Heading, ORANGE, PlotError, Scale, TEXT, UNIT, font,
    px, stroke, text,
};
use super::panel_head::{LegendEntry, Symbol};

/// Number of bars; odd, so that symmetric distributions have a middle bar.
pub const BARS: usize = 61;

/// Range of the horizontal axis, in microseconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HistogramRange {
    /// Lower end.
    pub low_us: f64,
    /// Upper end.
    pub high_us: f64,
}

impl HistogramRange {
    /// Range of these times in nanoseconds and of the nominal one in microseconds, with a margin;
    /// `None` without a time.
    pub fn around<'a>(
        times_ns: impl IntoIterator<Item = &'a u64>,
        nominal_us: f64,
    ) -> Option<Self> {
        let (mut low, mut high, mut has_time) = (nominal_us, nominal_us, false);
        for ns in times_ns {
            let us = *ns as f64 / 1e3;
            (low, high, has_time) = (low.min(us), high.max(us), true);
        }
        // Keeps a bar of equal times narrow.
        let margin = ((high - low) * 0.04).max(0.5);
        has_time.then_some(Self { low_us: low - margin, high_us: high + margin })
    }
}

/// Counts of times in equal intervals of a range.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    /// Range of the intervals.
    pub range: HistogramRange,
    /// Times per interval.
    pub counts: Vec<u64>,
}

impl Histogram {
    /// Counts times in nanoseconds; those outside the range are not counted.
    pub fn new(times_ns: &[u64], range: HistogramRange) -> Self {
        let mut counts = vec![0; BARS];
        let step = (range.high_us - range.low_us) / BARS as f64;
        for ns in times_ns {
            let number = (*ns as f64 / 1e3 - range.low_us) / step;
            if number >= 0.0
                && let Some(count) = counts.get_mut(number as usize)
            {
                *count += 1;
            }
        }
        Self { range, counts }
    }

    /// Largest count.
    pub fn largest(&self) -> u64 {
        self.counts.iter().copied().max().unwrap_or(0)
    }

    /// Width of an interval, in microseconds.
    pub fn step_us(&self) -> f64 {
        (self.range.high_us - self.range.low_us) / self.counts.len().max(1) as f64
    }
}

/// Histogram of one measurement.
#[derive(Debug, Clone)]
pub struct HistogramRow {
    /// Name of the measurement.
    pub title: String,
    /// Figures of the distribution.
    pub figures: String,
    /// Name of the times: rows of the same name have common axes in the left column.
    pub kind: String,
    /// Index of the measurement: rows of the same index have the same colour.
    pub measurement: usize,
    /// The times, in nanoseconds.
    pub times_ns: Vec<u64>,
}

/// Histograms of times: a row per measurement, on the left with common axes, on the right with its own.
#[derive(Debug, Clone, Default)]
pub struct HistogramFigure {
    /// Title and circumstances.
    pub heading: Heading,
    /// Nominal time, marked in each diagram, in microseconds.
    pub nominal_us: f64,
    /// Name and unit of the times: `period [us]`.
    pub x_label: String,
    /// Rows; those without a time are left out.
    pub rows: Vec<HistogramRow>,
}

const WIDTH: u32 = px(1_080);
const HEIGHT: u32 = px(268);
/// Height of the lines with title and legend.
const HEAD: i32 = 48 * UNIT;
const LEGEND: i32 = 18 * UNIT;
const MARGIN: i32 = 14 * UNIT;
const Y_LABELS: u32 = px(58);

/// Axes of a diagram.
struct Axes {
    range: HistogramRange,
    /// Largest count that the vertical axis must show.
    largest: u64,
}

impl HistogramFigure {
    /// Returns the picture.
    ///
    /// # Errors
    /// [`PlotError::Draw`].
    pub fn to_svg(&self) -> Result<String, PlotError> {
        let rows: Vec<_> = self.rows.iter().filter(|row| !row.times_ns.is_empty()).collect();
        let height = (HEIGHT * rows.len() as u32).max(1);
        canvas::picture(&self.heading, &self.description(), (WIDTH, height), |area| {
            let cells = area.split_evenly((rows.len().max(1), 2));
            for (row, cells) in rows.iter().zip(cells.chunks_exact(2)) {
                let of_kind = || rows.iter().filter(|other| other.kind == row.kind);
                let all = of_kind().flat_map(|other| &other.times_ns);
                let common = HistogramRange::around(all, self.nominal_us);
                let own = HistogramRange::around(&row.times_ns, self.nominal_us);
                let ([left, right], Some(common), Some(own)) = (cells, common, own) else {
                    continue;
                };
                let largest =
                    of_kind().map(|other| Histogram::new(&other.times_ns, common).largest()).max();
                let title = format!("{}: {}, common axes", row.title, row.kind);
                let axes = Axes { range: common, largest: largest.unwrap_or(0) };
                self.draw(left, row, &title, &axes)?;
                let title = format!("own axes: {}", row.figures);
                self.draw(right, row, &title, &Axes { range: own, largest: 0 })?;
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

    fn description(&self) -> String {
        let rows = self.rows.iter().filter(|row| !row.times_ns.is_empty());
        let texts = rows.map(|row| {
            let count = row.times_ns.len();
            format!("{}, {}: {}, {count} cycles", row.title, row.kind, row.figures)
        });
        format!(
            "Histograms of {}, cycles on a logarithmic axis, nominal {} us. {}",
            self.x_label,
            canvas::label(self.nominal_us, 10.0),
            texts.collect::<Vec<_>>().join("; ")
        )
    }

    /// Draws a diagram. The vertical axis is logarithmic, so that single times are visible next to
    /// thousands.
    fn draw(
        &self,
        area: &Area<'_>,
        row: &HistogramRow,
        title: &str,
        axes: &Axes,
    ) -> Result<(), PlotError> {
        let HistogramRange { low_us, high_us } = axes.range;
        let histogram = Histogram::new(&row.times_ns, axes.range);
        let largest = histogram.largest().max(axes.largest).max(8) as f64 * 1.3;
        let color = if row.measurement.is_multiple_of(2) { ORANGE } else { BLUE };
        let left = MARGIN + Y_LABELS as i32;
        text(area, title, (left, HEAD - LEGEND - 6 * UNIT), 15, TEXT, (HPos::Left, VPos::Bottom))?;
        let step = histogram.step_us();
        let bars = format!("cycles, {} us per bar", canvas::label(step, step));
        let bars = LegendEntry::new(bars, Symbol::Area(color.filled()));
        let nominal = format!("nominal {} us", canvas::label(self.nominal_us, 10.0));
        let nominal = LegendEntry::new(nominal, Symbol::Tick(stroke(FAINT, 1)));
        let middle = HEAD - LEGEND / 2 - 2 * UNIT;
        bars.draw(area, (left, middle))?;
        nominal.draw(area, (left + bars.width(), middle))?;
        let x = Scale::new(low_us..high_us, 8, AxisKind::Linear);
        // A single time has a visible bar.
        let least = 0.5;
        let mut chart = ChartBuilder::on(area)
            .margin_left(MARGIN)
            .margin_right(18 * UNIT)
            .margin_top(HEAD)
            .margin_bottom(4 * UNIT)
            .x_label_area_size(px(42))
            .y_label_area_size(Y_LABELS)
            .build_cartesian_2d(x.clone(), (least..largest).log_scale())
            .map_err(PlotError::draw)?;
        chart
            .configure_mesh()
            .y_labels(6)
            .max_light_lines(0)
            .bold_line_style(stroke(GRID, 1))
            .axis_style(stroke(FRAME, 1))
            .set_all_tick_mark_size(px(5))
            .label_style(font(13, TEXT))
            .axis_desc_style(font(14, TEXT))
            .x_label_formatter(&|us| x.label(*us))
            .y_label_formatter(&|count| canvas::label(*count, 10.0))
            .x_desc(x.name(&self.x_label))
            .y_desc("cycles, logarithmic")
            .draw()
            .map_err(PlotError::draw)?;
        let bars = histogram.counts.iter().enumerate().filter(|(_, count)| **count > 0);
        let bars = bars.map(|(number, count)| {
            let from = low_us + step * number as f64;
            let ends = [(from + step * 0.06, least), (from + step * 0.94, *count as f64)];
            Rectangle::new(ends, color.filled())
        });
        chart.draw_series(bars).map_err(PlotError::draw)?;
        let nominal = vec![(self.nominal_us, least), (self.nominal_us, largest)];
        let line = std::iter::once(PathElement::new(nominal, stroke(FAINT, 1)));
        chart.draw_series(line).map_err(PlotError::draw)?;
        if x.is_broken() {
            canvas::draw_break(area, (left + 8 * UNIT, HEIGHT as i32 - 46 * UNIT))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_time_in_the_range_is_counted() {
        let times: Vec<u64> = (0..1_000).map(|nth| 900_000 + nth * 200).collect();
        let range = HistogramRange::around(&times, 1_000.0).unwrap();
        assert!(range.low_us < 900.0 && range.high_us > 1_099.8);
        let histogram = Histogram::new(&times, range);
        assert_eq!(histogram.counts.iter().sum::<u64>(), 1_000);
        assert_eq!(HistogramRange::around([].iter(), 1.0), None);
    }
}
