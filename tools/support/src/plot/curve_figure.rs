//! Diagrams of curves above each other, over a common horizontal axis: time, frequency, a number.

use std::ops::Range;
use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use super::canvas;
use super::canvas::{
    AMBER, Area, AxisKind, FAINT, FRAME, GREEN, GRID, Heading, LIGHT_BLUE, ORANGE, PURPLE,
    PlotError, RED, Scale, TEXT, UNIT, font, px, stroke, text,
};
use super::panel_head::{Event, HEAD, LEFT, LegendEntry, PLOT_WIDTH, PanelHead, Symbol};

/// Diagrams of curves above each other.
#[derive(Debug, Clone, Default)]
pub struct CurveFigure {
    /// Title and circumstances.
    pub heading: Heading,
    /// Groups of diagrams, from top to bottom.
    pub stacks: Vec<CurveStack>,
}

/// Diagrams over a common horizontal axis.
#[derive(Debug, Clone, Default)]
pub struct CurveStack {
    /// Name and unit of the horizontal axis: `time since the start of motion [s]`.
    pub x_label: String,
    /// Kind of the horizontal axis.
    pub x_kind: AxisKind,
    /// Panels with the heights of their diagrams in pixels, without the space for events.
    pub panels: Vec<(CurvePanel, u32)>,
}

const WIDTH: u32 = px(1_000);

impl CurveFigure {
    /// Returns the picture.
    ///
    /// # Errors
    /// [`PlotError::Draw`].
    pub fn to_svg(&self) -> Result<String, PlotError> {
        let mut placed = Vec::new();
        for stack in &self.stacks {
            let x = stack.x_scale();
            for (number, (panel, height)) in (1..).zip(&stack.panels) {
                let is_last = number == stack.panels.len();
                let events = (panel.events(&x), panel.has_texts);
                let head = PanelHead::new(&panel.title, panel.legend(), events, &x);
                let height = px(*height) + head.height();
                placed.push((
                    panel,
                    head,
                    x.clone(),
                    is_last.then(|| x.name(&stack.x_label)),
                    height,
                ));
            }
        }
        let height = placed.iter().map(|placed| placed.4).sum::<u32>().max(px(1));
        canvas::picture(&self.heading, &self.description(), (WIDTH, height), |area| {
            let mut rest = area.clone();
            for (panel, head, x, x_label, height) in &placed {
                let (upper, lower) = rest.split_vertically(*height);
                panel.draw(&upper, head, x, x_label.as_deref())?;
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

    fn description(&self) -> String {
        let stacks = self.stacks.iter().map(|stack| {
            let x = stack.x_scale();
            let panels = stack.panels.iter().map(|(panel, _)| panel.description(&x));
            format!("Over {}: {}", x.name(&stack.x_label), panels.collect::<Vec<_>>().join("; "))
        });
        stacks.collect::<Vec<_>>().join(". ")
    }
}

impl CurveStack {
    fn x_scale(&self) -> Scale {
        let panels = || self.panels.iter().map(|panel| &panel.0);
        let points = panels().flat_map(|panel| &panel.series).flat_map(|series| &series.points);
        let marks = panels().flat_map(|panel| &panel.marks).map(|mark| mark.seconds);
        let bands = panels().flat_map(|panel| &panel.bands);
        let events = marks.chain(bands.flat_map(|band| [band.seconds.start, band.seconds.end]));
        let values = || points.clone().map(|point| point.0).chain(events.clone());
        let start = values().fold(f64::INFINITY, f64::min);
        let end = values().fold(f64::NEG_INFINITY, f64::max);
        let is_logarithmic = self.x_kind == AxisKind::Logarithmic;
        let range = match end > start {
            true if is_logarithmic => start / 1.1..end * 1.1,
            // An axis from 0, if the curves keep most of the width.
            true if start > 0.0 && start < end * 0.2 => 0.0..end,
            true => start..end,
            // A single sample, or none.
            false if end.is_finite() && is_logarithmic => end / 2.0..end * 2.0,
            false if end.is_finite() => end - 0.5..end + 0.5,
            false if is_logarithmic => 1.0..10.0,
            false => 0.0..1.0,
        };
        Scale::new(range, 12, self.x_kind)
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
    /// Horizontal value and value; the curve is interrupted where the value is missing. The points of a
    /// curve of few points are drawn.
    pub points: Vec<(f64, Option<f64>)>,
}

/// Kind of a marked period, with its own colour and entry in the legend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BandKind {
    /// Amber: the axis holds.
    Hold,
    /// Red: the drive has a fault.
    Fault,
    /// Grey: the drive is being stopped, or has stopped.
    Stop,
}

impl BandKind {
    fn name(self) -> &'static str {
        match self {
            Self::Hold => "holding",
            Self::Fault => "fault",
            Self::Stop => "stopping or stopped",
        }
    }

    fn style(self) -> ShapeStyle {
        match self {
            Self::Hold => AMBER.mix(0.45).filled(),
            Self::Fault => RED.mix(0.25).filled(),
            Self::Stop => FRAME.mix(0.35).filled(),
        }
    }
}

/// A period that is marked in all panels of a stack, for example a hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// First and last time, in seconds.
    pub seconds: Range<f64>,
    /// Text.
    pub text: String,
    /// Kind.
    pub kind: BandKind,
}

/// A moment that is marked in all panels of a stack.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Time in seconds.
    pub seconds: f64,
    /// Text; empty for a small mark at the lower edge, as for missed readings.
    pub text: String,
    /// The event is a fault: a red line, and its text is never left out for those of other events.
    pub is_fault: bool,
}

/// A diagram of curves.
#[derive(Debug, Clone, Default)]
pub struct CurvePanel {
    /// Title.
    pub title: String,
    /// Name and unit of the values: `position [inc]`.
    pub y_label: String,
    /// Kind of the vertical axis; linear or countable.
    pub y_kind: AxisKind,
    /// Range of the values, curves beyond which are clipped [default: that of the curves].
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
    /// Texts of bands and marks are listed above this panel; the other panels have their numbers only.
    pub has_texts: bool,
}

const Y_LABELS: u32 = px(80);
const X_LABELS: u32 = px(44);
const MARGIN: i32 = 16 * UNIT;
// The head of a panel is as wide as its diagram.
const _: () = assert!(LEFT == MARGIN + Y_LABELS as i32);
const _: () = assert!(PLOT_WIDTH == WIDTH as i32 - LEFT - MARGIN);
/// Most points of a curve that are drawn as points.
const POINTS: usize = 40;

impl CurvePanel {
    fn y_scale(&self) -> Scale {
        let values = self.series.iter().flat_map(|series| &series.points);
        let values = values.filter_map(|point| point.1);
        let y = self.y.clone().unwrap_or_else(|| canvas::range(values, self.least_width));
        Scale::new(y, 7, self.y_kind)
    }

    fn description(&self, x: &Scale) -> String {
        let y = self.y_scale();
        let curves: Vec<_> = self.series.iter().map(|series| series.name.as_str()).collect();
        let (start, end) = (y.exact(y.range.start), y.exact(y.range.end));
        let label = &self.y_label;
        let mut parts = vec![format!("{label} from {start} to {end}: {}", curves.join(", "))];
        if !self.title.is_empty() {
            parts.insert(0, self.title.clone());
        }
        if self.has_texts {
            parts.extend(self.events(x).into_iter().map(|event| event.text));
        }
        parts.join(", ")
    }

    /// Returns the events with a text in the order of their times.
    fn events(&self, x: &Scale) -> Vec<Event> {
        let event = |seconds: f64, text: &str, is_fault| Event {
            seconds,
            text: format!("{} s: {text}", x.exact(seconds)),
            is_fault,
        };
        let bands = self
            .bands
            .iter()
            .map(|band| event(band.seconds.start, &band.text, band.kind == BandKind::Fault));
        let marks = self.marks.iter().filter(|mark| !mark.text.is_empty());
        let marks = marks.map(|mark| event(mark.seconds, &mark.text, mark.is_fault));
        let mut events: Vec<_> = bands.chain(marks).collect();
        events.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        events
    }

    /// Draws the panel; only the last one of a stack names the horizontal axis.
    fn draw(
        &self,
        area: &Area<'_>,
        head: &PanelHead,
        x: &Scale,
        x_label: Option<&str>,
    ) -> Result<(), PlotError> {
        let y = self.y_scale();
        let Range { start: low, end: high } = y.range;
        let mut chart = ChartBuilder::on(area)
            .margin_left(MARGIN)
            .margin_right(MARGIN)
            .margin_top(HEAD + head.height() as i32)
            .margin_bottom(4 * UNIT)
            .x_label_area_size(x_label.map_or(px(22), |_| X_LABELS))
            .y_label_area_size(Y_LABELS)
            .build_cartesian_2d(x.clone(), y.clone())
            .map_err(PlotError::draw)?;
        chart
            .configure_mesh()
            .max_light_lines(0)
            .bold_line_style(stroke(GRID, 1))
            .axis_style(stroke(FRAME, 1))
            .set_all_tick_mark_size(px(5))
            .label_style(font(13, TEXT))
            .axis_desc_style(font(14, TEXT))
            .x_label_formatter(&|value| x.label(*value))
            .y_label_formatter(&|value| y.label(*value))
            .x_desc(x_label.unwrap_or_default())
            .y_desc(&self.y_label)
            .draw()
            .map_err(PlotError::draw)?;
        let bands = self.bands.iter().map(|band| {
            // A short band remains visible, also at the right end.
            let least = x.width() / 300.0;
            let start = band.seconds.start.min(x.range.end - least);
            let end = band.seconds.end.max(start + least).min(x.range.end);
            Rectangle::new([(start, low), (end, high)], band.kind.style())
        });
        chart.draw_series(bands).map_err(PlotError::draw)?;
        for mark in &self.marks {
            let (top, style) = match (mark.text.is_empty(), mark.is_fault) {
                (true, _) => (low + y.width() * 0.05, stroke(RED, 1)),
                (false, true) => (high, stroke(RED, 2)),
                (false, false) => (high, stroke(FAINT, 1)),
            };
            let ends = vec![(mark.seconds, low), (mark.seconds, top)];
            let line = std::iter::once(PathElement::new(ends, style));
            chart.draw_series(line).map_err(PlotError::draw)?;
        }
        for series in &self.series {
            let style = series.tone.style();
            let clipped = Clipped::of(&series.points, &y.range);
            for part in clipped.parts {
                if part.len() == 1 || series.points.len() <= POINTS {
                    let size = if part.len() == 1 { 2 } else { 3 } * UNIT;
                    let inside =
                        |point: &&(f64, f64)| part.len() == 1 || clipped.inside.contains(point);
                    let circle = |point: &(f64, f64)| Circle::new(*point, size, style.filled());
                    let circles = part.iter().filter(inside).map(circle);
                    chart.draw_series(circles).map_err(PlotError::draw)?;
                }
                if part.len() > 1 {
                    chart.draw_series(LineSeries::new(part, style)).map_err(PlotError::draw)?;
                }
            }
            let runs = clipped.runs.iter().map(|run| {
                let (middle, edge) = (f64::midpoint(run.start, run.end), run.edge(&y.range));
                let down = if run.is_above { UNIT } else { -UNIT };
                let triangle = vec![(0, 0), (-6 * UNIT, 10 * down), (6 * UNIT, 10 * down)];
                EmptyElement::at((middle, edge)) + Polygon::new(triangle, PURPLE.filled())
            });
            chart.draw_series(runs).map_err(PlotError::draw)?;
            let edges = clipped.runs.iter().map(|run| {
                let edge = run.edge(&y.range);
                PathElement::new(vec![(run.start, edge), (run.end, edge)], stroke(PURPLE, 4))
            });
            chart.draw_series(edges).map_err(PlotError::draw)?;
        }
        let top = HEAD + head.height() as i32;
        let bottom =
            area.dim_in_pixel().1 as i32 - 4 * UNIT - x_label.map_or(px(22), |_| X_LABELS) as i32;
        if y.is_broken() {
            // Beside the axis, where no curve begins.
            canvas::draw_break(area, (LEFT - 2 * UNIT, bottom - 8 * UNIT))?;
        }
        if x.is_broken() {
            canvas::draw_break(area, (LEFT + 12 * UNIT, bottom))?;
        }
        text(area, &self.title, (LEFT, HEAD / 2), 15, TEXT, (HPos::Left, VPos::Center))?;
        head.draw(area, x, top)
    }

    /// Returns the entries of the legend: curves, bands, marks, and what is not drawn as it is.
    fn legend(&self) -> Vec<LegendEntry> {
        let y = self.y_scale();
        let curve =
            |series: &Series| LegendEntry::new(&series.name, Symbol::Line(series.tone.style()));
        let mut entries: Vec<_> = self.series.iter().map(curve).collect();
        for kind in [BandKind::Hold, BandKind::Fault, BandKind::Stop] {
            if self.bands.iter().any(|band| band.kind == kind) {
                entries.push(LegendEntry::new(kind.name(), Symbol::Area(kind.style())));
            }
        }
        let small = self.marks.iter().filter(|mark| mark.text.is_empty()).count();
        if small > 0 && !self.mark_name.is_empty() {
            let name = format!("{} ({small})", self.mark_name);
            entries.push(LegendEntry::new(name, Symbol::Tick(stroke(RED, 1))));
        }
        let clipped = |series: &Series| Clipped::of(&series.points, &y.range).count;
        let clipped: usize = self.series.iter().map(clipped).sum();
        if clipped > 0 {
            let name = format!("clipped: {clipped} values beyond the axis");
            entries.push(LegendEntry::new(name, Symbol::Line(stroke(PURPLE, 4))));
        }
        if y.is_broken() {
            entries.push(LegendEntry::broken_axis());
        }
        entries
    }
}

/// A curve within the range of the vertical axis.
#[derive(Debug, Default)]
struct Clipped {
    /// Uninterrupted parts within the range.
    parts: Vec<Vec<(f64, f64)>>,
    /// Points of the curve within the range, without those where it crosses an edge.
    inside: Vec<(f64, f64)>,
    /// Periods in which the curve is beyond the range.
    runs: Vec<ClippedRun>,
    /// Number of values beyond the range.
    count: usize,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct ClippedRun {
    start: f64,
    end: f64,
    is_above: bool,
}

impl ClippedRun {
    fn edge(&self, y: &Range<f64>) -> f64 {
        if self.is_above { y.end } else { y.start }
    }
}

impl Clipped {
    fn of(points: &[(f64, Option<f64>)], y: &Range<f64>) -> Self {
        let mut clipped = Self::default();
        for part in points.split(|(_, value)| value.is_none_or(|value| !value.is_finite())) {
            let part: Vec<_> =
                part.iter().filter_map(|(at, value)| Some((*at, (*value)?))).collect();
            clipped.add_part(&part, y);
        }
        clipped
    }

    /// Adds an uninterrupted part.
    fn add_part(&mut self, part: &[(f64, f64)], y: &Range<f64>) {
        let mut open: Vec<(f64, f64)> = Vec::new();
        let mut run: Option<ClippedRun> = None;
        let mut last: Option<(f64, f64)> = None;
        for &(at, value) in part {
            for (crossing, edge, is_out) in crossings(last, (at, value), y) {
                if is_out {
                    open.push((crossing, edge));
                    self.parts.push(std::mem::take(&mut open));
                    run = Some(ClippedRun {
                        start: crossing,
                        end: crossing,
                        is_above: edge == y.end,
                    });
                } else {
                    self.runs.extend(run.take().map(|run| ClippedRun { end: crossing, ..run }));
                    open.push((crossing, edge));
                }
            }
            if (y.start..=y.end).contains(&value) {
                open.push((at, value));
                self.inside.push((at, value));
            } else {
                self.count += 1;
                let is_above = value > y.end;
                let run = run.get_or_insert(ClippedRun { start: at, end: at, is_above });
                run.end = at;
            }
            last = Some((at, value));
        }
        self.runs.extend(run);
        if !open.is_empty() {
            self.parts.push(open);
        }
    }
}

/// Returns the crossings of the edges on the way from a point to the next: position, edge, and whether the curve leaves the range.
fn crossings(
    from: Option<(f64, f64)>,
    to: (f64, f64),
    y: &Range<f64>,
) -> impl Iterator<Item = (f64, f64, bool)> {
    let found = from.map(|from| {
        let at = |edge: f64| from.0 + (to.0 - from.0) * (edge - from.1) / (to.1 - from.1);
        let is_out = |edge: f64| {
            let beyond = |value: f64| if edge == y.end { value > edge } else { value < edge };
            (beyond(from.1) != beyond(to.1)).then(|| beyond(to.1))
        };
        let edges = if to.1 > from.1 { [y.start, y.end] } else { [y.end, y.start] };
        edges.map(|edge| is_out(edge).map(|is_out| (at(edge), edge, is_out)))
    });
    found.into_iter().flatten().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clipped(points: &[(f64, Option<f64>)]) -> Clipped {
        Clipped::of(points, &(0.0..5.0))
    }

    #[test]
    fn curve_is_interrupted_where_a_value_is_missing() {
        let points =
            [(0.0, None), (1.0, Some(1.0)), (2.0, Some(3.0)), (3.0, None), (4.0, Some(2.0))];
        let clipped = clipped(&points);
        assert_eq!(clipped.parts, [vec![(1.0, 1.0), (2.0, 3.0)], vec![(4.0, 2.0)]]);
        assert_eq!((clipped.runs, clipped.count), (vec![], 0));
    }

    #[test]
    fn curve_beyond_the_axis_is_interrupted_and_marked() {
        let values = [4.0, 6.0, 7.0, 3.0, -1.0, 9.0, 4.0];
        let points: Vec<_> = (0..).zip(values).map(|(at, y)| (f64::from(at), Some(y))).collect();
        let clipped = clipped(&points);
        assert_eq!(clipped.parts[0], [(0.0, 4.0), (0.5, 5.0)]);
        assert_eq!(clipped.parts[1], [(2.5, 5.0), (3.0, 3.0), (3.75, 0.0)]);
        assert_eq!(clipped.parts.len(), 4, "one from edge to edge: {clipped:?}");
        let runs: Vec<_> = clipped.runs.iter().map(|run| (run.start, run.is_above)).collect();
        assert_eq!(runs, [(0.5, true), (3.75, false), (4.6, true)]);
        assert_eq!((clipped.runs[0].end, clipped.count), (2.5, 4));
        assert!(clipped.parts.iter().flatten().all(|point| (0.0..=5.0).contains(&point.1)));
    }
}
