//! The frame of every picture: heading, legend, body, circumstances of the run; scales of its axes.

use std::ops::Range;
use std::path::{Path, PathBuf};

use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use thiserror::Error;

use crate::command_line::new_file;
use crate::command_line::new_file::{Existing, WholeFile};
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
pub const AMBER: RGBColor = RGBColor(0xF6, 0xC3, 0x5B);
pub const PURPLE: RGBColor = RGBColor(0x8E, 0x44, 0xAD);

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

/// Draws a picture: `body` gets an area of this size in units. The description is for readers who
/// cannot see the picture.
pub fn picture(
    heading: &Heading,
    description: &str,
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
    let svg = svg.replacen(
        &format!("<svg width=\"{width}\" height=\"{height}\""),
        &format!("<svg role=\"img\" width=\"{}\" height=\"{}\"", pixels(width), pixels(height)),
        1,
    );
    let simulated = if heading.is_simulated { "Simulated run. " } else { "" };
    let subtitle = match heading.subtitle.as_str() {
        "" => String::new(),
        subtitle => format!("{subtitle}. "),
    };
    let texts = format!(
        ">\n<title>{}</title>\n<desc>{}</desc>",
        escaped(&heading.title),
        escaped(&format!("{simulated}{subtitle}{description}"))
    );
    Ok(svg.replacen('>', &texts, 1))
}

/// Escapes the characters that XML reserves.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// Checks before a measurement that the picture can be written at its end.
///
/// # Errors
/// [`PlotError::Write`].
pub fn check_file(path: Option<&Path>) -> Result<(), PlotError> {
    let Some(path) = path else { return Ok(()) };
    let prepared = WholeFile::create(path, Existing::Replace);
    prepared.map(drop).map_err(|source| PlotError::Write { path: path.to_owned(), source })
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

/// Lines of the circumstances; the command line continues until it is complete.
fn footer(heading: &Heading, width: u32) -> Vec<String> {
    let Some(run) = &heading.run else { return Vec::new() };
    let most = (width.saturating_sub(2 * MARGIN as u32) / FOOT_CHARACTER) as usize;
    let facts = format!("{}, {}, {}", run.date(), run.program(), run.kernel());
    std::iter::once(facts).chain(run.command_lines(most)).collect()
}

/// Width of a character at 13 px, in units: enough for most fonts.
const CHARACTER: f64 = 6.3 * UNIT as f64;

/// Width of a text at 13 px, in units.
pub fn text_width(content: &str) -> i32 {
    (content.chars().count() as f64 * CHARACTER) as i32
}

/// Splits a text into lines of this width in units, between words.
pub fn wrapped(content: &str, width: i32) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in content.split_whitespace() {
        match lines.last_mut() {
            Some(line) if text_width(line) + text_width(word) + px(6) as i32 <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Draws the mark of an axis that does not begin at 0: two strokes across the axis.
pub fn draw_break(area: &Area<'_>, (x, y): (i32, i32)) -> Result<(), PlotError> {
    for shift in [-2 * UNIT, 2 * UNIT] {
        let ends = vec![(x - 4 * UNIT, y + shift + 2 * UNIT), (x + 4 * UNIT, y + shift - 2 * UNIT)];
        area.draw(&PathElement::new(ends, stroke(TEXT, 2))).map_err(PlotError::draw)?;
    }
    Ok(())
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
    #[error("cannot write {}: {source}", path.display())]
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

/// Returns the range of these values, at least `least` wide. It begins or ends at 0 if the curves keep
/// a quarter of the height; other ends have a margin of 6 %.
pub fn range(values: impl Iterator<Item = f64>, least: f64) -> Range<f64> {
    let mut ends: Option<(f64, f64)> = None;
    for value in values.filter(|value| value.is_finite()) {
        let (low, high) = ends.unwrap_or((value, value));
        ends = Some((low.min(value), high.max(value)));
    }
    let (low, high) = ends.unwrap_or((0.0, 0.0));
    let width = (high - low).max(least);
    if low >= 0.0 && width >= high / 4.0 && high > 0.0 {
        return 0.0..(high * 1.06).max(least);
    }
    if high <= 0.0 && width >= -low / 4.0 && low < 0.0 {
        return (low * 1.06).min(-least)..0.0;
    }
    let missing = (least - (high - low)).max(0.0) / 2.0;
    let margin = missing + (high - low) * 0.06;
    low - margin..high + margin
}

/// Kind of an axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum AxisKind {
    /// Ticks in equal distances.
    #[default]
    Linear,
    /// Countable values: ticks at integers only.
    Count,
    /// Logarithmic; the values are above 0.
    Logarithmic,
}

/// Range and ticks of an axis.
#[derive(Debug, Clone)]
pub struct Scale {
    pub range: Range<f64>,
    ticks: Vec<f64>,
    kind: AxisKind,
    decimals: usize,
}

impl Scale {
    /// Scale of these values with about this number of ticks.
    pub fn new(range: Range<f64>, most: usize, kind: AxisKind) -> Self {
        if kind == AxisKind::Logarithmic {
            return Self::logarithmic(range);
        }
        let raw = (range.end - range.start) / most.max(1) as f64;
        let magnitude = 10_f64.powf(raw.log10().floor());
        let steps = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * magnitude);
        let step = steps.into_iter().find(|step| *step >= raw * 0.999).unwrap_or(raw);
        let step = if kind == AxisKind::Count { step.max(1.0) } else { step };
        let (first, last) = ((range.start / step).ceil(), (range.end / step + 1e-9).floor());
        let count = (last - first).clamp(-1.0, 200.0) as i32;
        let ticks = (0..=count).map(|nth| (first + f64::from(nth)) * step).collect();
        let decimals = (-(step * 1.001).log10().floor()).clamp(0.0, 9.0) as usize;
        Self { range, ticks, kind, decimals }
    }

    /// Ticks at 1, 2 and 5 times the powers of ten.
    fn logarithmic(range: Range<f64>) -> Self {
        let range = range.start.max(f64::MIN_POSITIVE)..range.end.max(f64::MIN_POSITIVE);
        let powers = range.start.log10().floor() as i32..=range.end.log10().ceil() as i32;
        let ticks = powers.flat_map(|power| [1.0, 2.0, 5.0].map(|n| n * 10_f64.powi(power)));
        let inside = |tick: &f64| (range.start * 0.999..=range.end * 1.001).contains(tick);
        let ticks = ticks.filter(inside).collect();
        Self { range, ticks, kind: AxisKind::Logarithmic, decimals: 0 }
    }

    /// Position of a value on the axis, 0 at its begin and 1 at its end.
    pub fn fraction(&self, value: f64) -> f64 {
        let Range { start, end } = self.range;
        match self.kind {
            AxisKind::Logarithmic => {
                (value.max(start / 1e3) / start).log10() / (end / start).log10()
            }
            _ => (value - start) / (end - start),
        }
    }

    /// Width in units of the values.
    pub fn width(&self) -> f64 {
        self.range.end - self.range.start
    }

    /// Returns whether a linear axis does not show 0.
    pub fn is_broken(&self) -> bool {
        self.kind != AxisKind::Logarithmic && !(self.range.start..=self.range.end).contains(&0.0)
    }

    /// Text of a tick.
    pub fn label(&self, tick: f64) -> String {
        let decimals = match self.kind {
            AxisKind::Logarithmic => (-(tick * 1.001).log10().floor()).clamp(0.0, 9.0) as usize,
            _ => self.decimals,
        };
        without_sign_of_zero(format!("{tick:.decimals$}"))
    }

    /// Text of a value between the ticks, with two more decimals.
    pub fn exact(&self, value: f64) -> String {
        let decimals = match self.kind {
            AxisKind::Count => 0,
            _ => self.decimals + 2,
        };
        without_sign_of_zero(format!("{value:.decimals$}"))
    }

    /// Name of the axis, with what its ticks do not show.
    pub fn name(&self, label: &str) -> String {
        match self.kind {
            AxisKind::Logarithmic => format!("{label}, logarithmic"),
            _ if self.is_broken() => format!("{label}, axis does not begin at 0"),
            _ => label.to_owned(),
        }
    }
}

impl Ranged for Scale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let position = f64::from(from) + self.fraction(*value) * f64::from(to - from);
        // The cast saturates.
        if position.is_finite() { position.round() as i32 } else { from }
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

/// Returns `0` for texts such as `-0.00`.
fn without_sign_of_zero(text: String) -> String {
    let is_zero = text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
    if is_zero { "0".to_owned() } else { text }
}

/// Formats a value of an axis of this width: as many decimals as its ticks need.
pub fn label(value: f64, width: f64) -> String {
    let step = width.abs() / 10.0;
    let decimals = if step > 0.0 { (-step.log10().floor()).clamp(0.0, 9.0) as usize } else { 0 };
    without_sign_of_zero(format!("{value:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_get_a_range_of_the_least_width() {
        assert_eq!(range([50.0, 50.0].into_iter(), 4.0), 48.0..52.0);
        assert_eq!(range(std::iter::empty(), 2.0), -1.0..1.0);
    }

    #[test]
    fn range_begins_at_0_unless_the_curves_would_be_flat() {
        let ends = |values: &[f64]| {
            let Range { start, end } = range(values.iter().copied(), 0.0);
            [start, end].map(|value| (value * 100.0).round() / 100.0)
        };
        assert_eq!(ends(&[f64::NAN, 10.0, 20.0]), [0.0, 21.2]);
        assert_eq!(ends(&[-10.0, -20.0]), [-21.2, 0.0]);
        assert_eq!(ends(&[100.0, 110.0]), [99.4, 110.6]);
        assert_eq!(ends(&[-1.0, 1.0]), [-1.12, 1.12]);
        let scale = |values| Scale::new(values, 7, AxisKind::Linear);
        assert!(scale(99.4..110.6).is_broken() && scale(-9.0..-1.0).is_broken());
        assert!(!scale(0.0..21.2).is_broken() && !scale(-1.0..0.0).is_broken());
        assert_eq!(scale(99.4..110.6).name("load [%]"), "load [%], axis does not begin at 0");
    }

    fn labels(values: Range<f64>, kind: AxisKind) -> Vec<String> {
        let scale = Scale::new(values, 7, kind);
        scale.ticks.iter().map(|tick| scale.label(*tick)).collect()
    }

    #[test]
    fn ticks_of_countable_values_are_integers() {
        assert_eq!(
            labels(0.0..3.0, AxisKind::Linear),
            ["0", "0.5", "1.0", "1.5", "2.0", "2.5", "3.0"]
        );
        assert_eq!(labels(0.0..3.0, AxisKind::Count), ["0", "1", "2", "3"]);
        assert_eq!(labels(1_004.9..1_009.1, AxisKind::Count).len(), 5);
        assert_eq!(labels(-0.2..0.2, AxisKind::Count), ["0"]);
        assert_eq!(labels(0.0..70_000.0, AxisKind::Count)[1], "10000");
    }

    #[test]
    fn ticks_of_a_logarithmic_axis_are_1_2_5() {
        assert_eq!(labels(0.5..20.0, AxisKind::Logarithmic), ["0.5", "1", "2", "5", "10", "20"]);
        let scale = Scale::new(1.0..100.0, 7, AxisKind::Logarithmic);
        assert_eq!((scale.map(&10.0, (0, 800)), scale.map(&100.0, (0, 800))), (400, 800));
        assert_eq!(scale.name("frequency [Hz]"), "frequency [Hz], logarithmic");
    }

    #[test]
    fn long_texts_continue_in_the_next_line() {
        let text = "the drive is in fault, error code 0x2310";
        let lines = wrapped(text, text_width("the drive is in fault,") + px(6) as i32);
        assert_eq!(lines, ["the drive is in fault,", "error code 0x2310"]);
    }

    #[test]
    fn labels_have_the_decimals_of_their_ticks() {
        assert_eq!(label(120_000.0, 200_000.0), "120000");
        assert_eq!(label(0.25, 1.0), "0.2");
        assert_eq!(label(0.0005, 0.002), "0.0005");
        assert_eq!(label(-0.0, 3.0), "0");
    }
}
