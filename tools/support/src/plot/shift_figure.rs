//! Usable Sync0 shifts of configurations.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use super::canvas;
use super::canvas::{
    Area, BLUE, FRAME, GREEN, GRID, Heading, PlotError, RED, TEXT, UNIT, font, px, stroke, text,
};

/// Tested Sync0 shifts of one configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct ShiftRow {
    /// Name of the configuration: `1 ms, 384B`.
    pub title: String,
    /// Sync0 period in nanoseconds.
    pub period_ns: u32,
    /// The tested shifts in nanoseconds, with whether each is usable.
    pub shifts: Vec<(u32, bool)>,
    /// The recommended one of them.
    pub recommended_ns: Option<u32>,
    /// First and last shift that the plan finds usable, in nanoseconds; cyclic.
    pub planned_ns: Option<(u32, u32)>,
}

/// Usable Sync0 shifts: a row per configuration.
#[derive(Debug, Clone, Default)]
pub struct ShiftFigure {
    /// Title and circumstances.
    pub heading: Heading,
    /// Rows.
    pub rows: Vec<ShiftRow>,
}

const WIDTH: u32 = px(900);
const ROW: u32 = px(124);
const TITLES: u32 = px(120);
const LEGEND: u32 = px(30);
/// Height of the bars of tested shifts, and of the range of the plan.
const TESTED: (f64, f64) = (0.45, 0.85);
const PLANNED: (f64, f64) = (0.15, 0.32);

impl ShiftFigure {
    /// Returns the picture.
    ///
    /// # Errors
    /// [`PlotError::Draw`].
    pub fn to_svg(&self) -> Result<String, PlotError> {
        let height = LEGEND + ROW * self.rows.len() as u32;
        canvas::picture(&self.heading, &self.description(), (WIDTH, height), |area| {
            let (legend, rest) = area.split_vertically(LEGEND);
            draw_legend(&legend)?;
            for (row, area) in self.rows.iter().zip(rest.split_evenly((self.rows.len().max(1), 1)))
            {
                row.draw(&area)?;
            }
            Ok(())
        })
    }

    fn description(&self) -> String {
        let rows = self.rows.iter().map(|row| {
            let usable = row.shifts.iter().filter(|shift| shift.1);
            let usable = usable.map(|shift| (shift.0 / 1_000).to_string()).collect::<Vec<_>>();
            let recommended =
                row.recommended_ns.map_or("none".to_owned(), |ns| (ns / 1_000).to_string());
            format!(
                "{}: {} shifts tested, usable [us]: {}, recommended [us]: {recommended}",
                row.title,
                row.shifts.len(),
                usable.join(", ")
            )
        });
        format!("Sync0 shifts from 0 to their period. {}", rows.collect::<Vec<_>>().join("; "))
    }

    /// Writes the picture to a file.
    ///
    /// # Errors
    /// [`PlotError`].
    pub fn write(&self, path: &Path) -> Result<(), PlotError> {
        canvas::write(path, &self.to_svg()?)
    }
}

fn draw_legend(area: &Area<'_>) -> Result<(), PlotError> {
    let entries = [
        (GREEN, "tested, usable"),
        (RED, "tested, not usable"),
        (BLUE, "usable by the plan"),
        (TEXT, "recommended"),
    ];
    let mut x = TITLES as i32;
    for (color, name) in entries {
        let sample: DynElement<'_, _, (i32, i32)> = match name {
            "recommended" => {
                Circle::new((x + 7 * UNIT, 12 * UNIT), 5 * UNIT, stroke(color, 2)).into_dyn()
            }
            _ => Rectangle::new([(x, 6 * UNIT), (x + 14 * UNIT, 18 * UNIT)], color.filled())
                .into_dyn(),
        };
        area.draw(&sample).map_err(PlotError::draw)?;
        text(area, name, (x + 20 * UNIT, 12 * UNIT), 13, TEXT, (HPos::Left, VPos::Center))?;
        x += (40 + name.len() as i32 * 7) * UNIT;
    }
    Ok(())
}

impl ShiftRow {
    fn draw(&self, area: &Area<'_>) -> Result<(), PlotError> {
        let period_us = f64::from(self.period_ns.max(1)) / 1e3;
        let us = |ns: u32| f64::from(ns) / 1e3;
        // The bars of the first and the last shift are as wide as the others.
        let step = period_us / self.shifts.len().max(1) as f64;
        let half = step * 0.35;
        let mut chart = ChartBuilder::on(area)
            .margin_right(20 * UNIT)
            .margin_top(4 * UNIT)
            .x_label_area_size(px(42))
            .y_label_area_size(TITLES)
            .build_cartesian_2d(-half..period_us, 0.0..1.0)
            .map_err(PlotError::draw)?;
        chart
            .configure_mesh()
            .x_labels(11)
            .disable_y_mesh()
            .disable_y_axis()
            .max_light_lines(0)
            .bold_line_style(stroke(GRID, 1))
            .axis_style(stroke(FRAME, 1))
            .set_all_tick_mark_size(px(5))
            .label_style(font(13, TEXT))
            .axis_desc_style(font(14, TEXT))
            .x_label_formatter(&|us| canvas::label(*us, period_us))
            .x_desc("Sync0 shift [us]")
            .draw()
            .map_err(PlotError::draw)?;
        let bars = self.shifts.iter().map(|(shift, is_usable)| {
            let (middle, color) = (us(*shift), if *is_usable { GREEN } else { RED });
            Rectangle::new([(middle - half, TESTED.0), (middle + half, TESTED.1)], color.filled())
        });
        chart.draw_series(bars).map_err(PlotError::draw)?;
        let planned = match self.planned_ns {
            None => Vec::new(),
            Some((first, last)) if first <= last => vec![(us(first), us(last))],
            Some((first, last)) => vec![(us(first), period_us), (0.0, us(last))],
        };
        let planned = planned
            .into_iter()
            .map(|(from, to)| Rectangle::new([(from, PLANNED.0), (to, PLANNED.1)], BLUE.filled()));
        chart.draw_series(planned).map_err(PlotError::draw)?;
        let middle = (TESTED.0 + TESTED.1) / 2.0;
        let recommended = self.recommended_ns.map(|ns| (us(ns), middle));
        let filled = recommended.map(|at| Circle::new(at, 6 * UNIT, WHITE.filled()));
        chart.draw_series(filled).map_err(PlotError::draw)?;
        let outlined = recommended.map(|at| Circle::new(at, 6 * UNIT, stroke(TEXT, 2)));
        chart.draw_series(outlined).map_err(PlotError::draw)?;
        text(
            area,
            &self.title,
            (TITLES as i32 - 12 * UNIT, 40 * UNIT),
            14,
            TEXT,
            (HPos::Right, VPos::Center),
        )
    }
}
