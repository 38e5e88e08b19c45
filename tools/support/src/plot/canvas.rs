//! The frame of every picture: heading, body, circumstances of the run; ranges and labels of its axes.

use std::ops::Range;
use std::path::{Path, PathBuf};

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use thiserror::Error;

use crate::command_line::new_file;
use crate::command_line::run_info::RunInfo;

/// Part of a picture.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

pub const FONT: &str = "sans-serif";
pub const TEXT: RGBColor = RGBColor(0x22, 0x22, 0x22);
pub const FAINT: RGBColor = RGBColor(0x66, 0x66, 0x66);
pub const FRAME: RGBColor = RGBColor(0x99, 0x99, 0x99);
pub const GRID: RGBColor = RGBColor(0xDD, 0xDD, 0xDD);
pub const BLUE: RGBColor = RGBColor(0x0B, 0x62, 0xA4);
pub const LIGHT_BLUE: RGBColor = RGBColor(0x86, 0xBC, 0xE6);
pub const ORANGE: RGBColor = RGBColor(0xD9, 0x54, 0x2B);
pub const GREEN: RGBColor = RGBColor(0x2E, 0x8B, 0x3A);
pub const RED: RGBColor = RGBColor(0xC0, 0x2B, 0x2B);
pub const BAND: RGBColor = RGBColor(0xF6, 0xC3, 0x5B);

/// Units per pixel. The drawing library has integer coordinates, which alone would round a curve to
/// whole pixels.
pub const UNIT: i32 = 8;
const HEAD: u32 = px(34);
const SUBTITLE: u32 = px(18);
const FOOT_LINE: u32 = px(16);
const MARGIN: i32 = 12 * UNIT;
/// Width of a character of the footer, in units: enough for a cautious cut.
const FOOT_CHARACTER: u32 = px(6);

/// Converts pixels into units of the drawing.
pub const fn px(pixels: u32) -> u32 {
    pixels * UNIT as u32
}

/// The font of this size in pixels and colour.
pub fn font(size: i32, color: RGBColor) -> TextStyle<'static> {
    (FONT, size * UNIT).into_font().color(&color)
}

/// A line of this width in pixels and colour.
pub fn stroke(color: RGBColor, width: u32) -> ShapeStyle {
    color.stroke_width(px(width))
}

/// Draws a picture: `body` gets an area of this size in units.
pub fn picture(
    heading: &Heading,
    (width, height): (u32, u32),
    body: impl FnOnce(&Area<'_>) -> Result<(), PlotError>,
) -> Result<String, PlotError> {
    let footer = footer(heading, width);
    let head = HEAD + if heading.subtitle.is_empty() { 0 } else { SUBTITLE };
    let foot = match footer.len() as u32 {
        0 => 0,
        lines => lines * FOOT_LINE + px(8),
    };
    let mut svg = String::new();
    {
        let root =
            SVGBackend::with_string(&mut svg, (width, head + height + foot)).into_drawing_area();
        root.fill(&WHITE).map_err(PlotError::draw)?;
        let (top, rest) = root.split_vertically(head);
        let (middle, bottom) = rest.split_vertically(height);
        draw_heading(&top, heading, width)?;
        body(&middle)?;
        for (line, y) in footer.iter().zip((2 * UNIT..).step_by(FOOT_LINE as usize)) {
            text(&bottom, line, (MARGIN, y), 12, FAINT, (HPos::Left, VPos::Top))?;
        }
        root.present().map_err(PlotError::draw)?;
    }
    let height = head + height + foot;
    let pixels = |length: u32| length / px(1);
    Ok(svg.replacen(
        &format!("<svg width=\"{width}\" height=\"{height}\""),
        &format!("<svg width=\"{}\" height=\"{}\"", pixels(width), pixels(height)),
        1,
    ))
}

/// Writes a picture to a file.
pub fn write(path: &Path, svg: &str) -> Result<(), PlotError> {
    new_file::write(path, svg).map_err(|source| PlotError::Write { path: path.to_owned(), source })
}

/// Draws a text at a position of the area, in units; the size is in pixels.
pub fn text(
    area: &Area<'_>,
    content: &str,
    position: (i32, i32),
    size: i32,
    color: RGBColor,
    (horizontal, vertical): (HPos, VPos),
) -> Result<(), PlotError> {
    let style = font(size, color).pos(Pos::new(horizontal, vertical));
    area.draw_text(content, &style, position).map_err(PlotError::draw)
}

fn draw_heading(area: &Area<'_>, heading: &Heading, width: u32) -> Result<(), PlotError> {
    let title = (FONT, 18 * UNIT, FontStyle::Bold).into_font().color(&TEXT);
    area.draw_text(&heading.title, &title, (MARGIN, 10 * UNIT)).map_err(PlotError::draw)?;
    if !heading.subtitle.is_empty() {
        let at = (MARGIN, HEAD as i32);
        text(area, &heading.subtitle, at, 14, FAINT, (HPos::Left, VPos::Top))?;
    }
    if heading.is_simulated {
        let right = width as i32 - MARGIN;
        let (left, top, bottom) = (right - 116 * UNIT, 7 * UNIT, 31 * UNIT);
        let frame = Rectangle::new([(left, top), (right, bottom)], RED.filled());
        area.draw(&frame).map_err(PlotError::draw)?;
        let style = (FONT, 15 * UNIT, FontStyle::Bold).into_font().color(&WHITE);
        let style = style.pos(Pos::new(HPos::Center, VPos::Center));
        let middle = ((left + right) / 2, (top + bottom) / 2);
        area.draw_text("SIMULATED", &style, middle).map_err(PlotError::draw)?;
    }
    Ok(())
}

/// Lines of the circumstances, cut to the width of the picture.
fn footer(heading: &Heading, width: u32) -> Vec<String> {
    let Some(run) = &heading.run else { return Vec::new() };
    let most = (width.saturating_sub(2 * MARGIN as u32) / FOOT_CHARACTER) as usize;
    let facts = format!("{}, {}, {}", run.date(), run.program(), run.kernel());
    let cut = |line: String| match line.char_indices().nth(most) {
        None => line,
        Some((end, _)) => format!("{}...", line.get(..end).unwrap_or_default()),
    };
    [facts, run.command_line().to_owned()].map(cut).into()
}

/// Title of a picture, and the circumstances of the run.
#[derive(Debug, Clone, Default)]
pub struct Heading {
    /// Title.
    pub title: String,
    /// Second line: the settings of the measurement. Empty for none.
    pub subtitle: String,
    /// The run was simulated: the picture is marked.
    pub is_simulated: bool,
    /// Date, program, kernel and command line, below the picture.
    pub run: Option<RunInfo>,
}

impl Heading {
    /// A heading of a run on real hardware.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), ..Self::default() }
    }

    /// The same with a second line.
    #[must_use]
    pub fn with_subtitle(self, subtitle: impl Into<String>) -> Self {
        Self { subtitle: subtitle.into(), ..self }
    }

    /// The same with the mark of a simulated run.
    #[must_use]
    pub fn simulated(self, is_simulated: bool) -> Self {
        Self { is_simulated, ..self }
    }

    /// The same with the circumstances of the run.
    #[must_use]
    pub fn with_run(self, run: RunInfo) -> Self {
        Self { run: Some(run), ..self }
    }
}

/// Error of a picture.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PlotError {
    /// The file cannot be written.
    #[error("cannot write {}: {source}; use a writable directory", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The picture cannot be drawn.
    #[error("cannot draw the picture: {reason}")]
    Draw {
        /// Error of the drawing library.
        reason: String,
    },
}

impl PlotError {
    /// An error of the drawing library.
    pub(crate) fn draw(error: impl std::fmt::Display) -> Self {
        Self::Draw { reason: error.to_string() }
    }
}

/// Returns the range of these values with a margin of 6 %, at least `least` wide.
pub fn range(values: impl Iterator<Item = f64>, least: f64) -> Range<f64> {
    let mut ends: Option<(f64, f64)> = None;
    for value in values.filter(|value| value.is_finite()) {
        let (low, high) = ends.unwrap_or((value, value));
        ends = Some((low.min(value), high.max(value)));
    }
    let (low, high) = ends.unwrap_or((0.0, 0.0));
    let missing = (least - (high - low)).max(0.0) / 2.0;
    let margin = missing + (high - low) * 0.06;
    low - margin..high + margin
}

/// Formats a value of an axis of this width: as many decimals as its ticks need.
pub fn label(value: f64, width: f64) -> String {
    let step = width.abs() / 10.0;
    let decimals = if step > 0.0 { (-step.log10().floor()).clamp(0.0, 9.0) as usize } else { 0 };
    let text = format!("{value:.decimals$}");
    let is_zero = text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
    if is_zero { "0".to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_get_a_range_of_the_least_width() {
        assert_eq!(range([5.0, 5.0].into_iter(), 4.0), 3.0..7.0);
        assert_eq!(range(std::iter::empty(), 2.0), -1.0..1.0);
        assert_eq!(range([f64::NAN, 1.0, 2.0].into_iter(), 0.0), 0.94..2.06);
    }

    #[test]
    fn labels_have_the_decimals_of_their_ticks() {
        assert_eq!(label(120_000.0, 200_000.0), "120000");
        assert_eq!(label(0.25, 1.0), "0.2");
        assert_eq!(label(0.0005, 0.002), "0.0005");
        assert_eq!(label(-0.0, 3.0), "0");
    }
}
