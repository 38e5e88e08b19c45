//! The frame of every picture: heading, body, circumstances of the run.

use std::path::Path;

use crate::command_line::new_file;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::plot::heading::Heading;
use crate::plot::plot_error::PlotError;

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
