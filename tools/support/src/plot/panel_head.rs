//! What is above a diagram: the legend, the texts of the events, and their numbers at their times.

use plotters::coord::ranged1d::Ranged as _;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas;
use super::canvas::{Area, PlotError, RED, Scale, TEXT, UNIT, draw_break, text, text_width};

/// Left end and width of the diagram below, in units.
pub const LEFT: i32 = 96 * UNIT;
pub const PLOT_WIDTH: i32 = 888 * UNIT;
/// Height of the line with the title, and of each line of the legend.
pub const HEAD: i32 = 26 * UNIT;
const LEGEND_ROW: i32 = 20 * UNIT;
/// Most rows of texts of a panel.
const TEXT_ROWS: usize = 12;
const TEXT_ROW: i32 = 16 * UNIT;
/// Height of the line with the numbers of events.
const NUMBERS: i32 = 15 * UNIT;
/// Distance between two numbers; closer events have a common one.
const NUMBER_WIDTH: f64 = 16.0 * UNIT as f64;

/// Entry of a legend.
pub struct LegendEntry {
    pub name: String,
    pub symbol: Symbol,
}

/// Symbol of a legend entry.
#[derive(Clone, Copy)]
pub enum Symbol {
    Line(ShapeStyle),
    /// A short vertical line.
    Tick(ShapeStyle),
    Area(ShapeStyle),
    /// The mark of an axis that does not begin at 0.
    Break,
}

const SYMBOL: i32 = 22 * UNIT;

impl LegendEntry {
    pub fn new(name: impl Into<String>, symbol: Symbol) -> Self {
        Self { name: name.into(), symbol }
    }

    /// The entry of a vertical axis that does not begin at 0.
    pub fn broken_axis() -> Self {
        Self::new("vertical axis does not begin at 0", Symbol::Break)
    }

    /// Width with the distance to the next entry, in units.
    pub fn width(&self) -> i32 {
        SYMBOL + 6 * UNIT + text_width(&self.name) + 14 * UNIT
    }

    /// Draws the entry at its left end and the middle of its line.
    pub fn draw(&self, area: &Area<'_>, (left, middle): (i32, i32)) -> Result<(), PlotError> {
        let center = left + SYMBOL / 2;
        let line = |points: [(i32, i32); 2], style| {
            area.draw(&PathElement::new(points.to_vec(), style)).map_err(PlotError::draw)
        };
        match self.symbol {
            Symbol::Line(style) => line([(left, middle), (left + SYMBOL, middle)], style)?,
            Symbol::Tick(style) => {
                line([(center, middle - 6 * UNIT), (center, middle + 6 * UNIT)], style)?;
            }
            Symbol::Area(style) => {
                let corners = [(left, middle - 6 * UNIT), (left + SYMBOL, middle + 6 * UNIT)];
                area.draw(&Rectangle::new(corners, style)).map_err(PlotError::draw)?;
            }
            Symbol::Break => draw_break(area, (center, middle))?,
        }
        let at = (left + SYMBOL + 6 * UNIT, middle);
        text(area, &self.name, at, 13, TEXT, (HPos::Left, VPos::Center))
    }
}

/// An event with a text.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    pub seconds: f64,
    /// Time and text.
    pub text: String,
    pub is_fault: bool,
}

/// Events so close to each other that they have a common number.
#[derive(Debug, Clone, PartialEq)]
struct EventGroup {
    seconds: f64,
    texts: Vec<String>,
    is_fault: bool,
}

/// What is above the diagram of a panel: legend, texts of the events, and their numbers at their times.
/// The head lies outside the diagram, so that it covers no curve.
pub struct PanelHead {
    legend: Vec<LegendEntry>,
    /// Lines of the legend, as numbers of entries; none if it is beside the title.
    legend_rows: Vec<usize>,
    groups: Vec<EventGroup>,
    /// Texts that have no space.
    hidden: usize,
    has_texts: bool,
}

impl PanelHead {
    /// The head of a panel. Only a panel with texts lists the events; all have the same numbers.
    pub fn new(
        title: &str,
        legend: Vec<LegendEntry>,
        (mut events, has_texts): (Vec<Event>, bool),
        x: &Scale,
    ) -> Self {
        let widths: Vec<i32> = legend.iter().map(LegendEntry::width).collect();
        let beside = PLOT_WIDTH - text_width(title) * 15 / 13 - 20 * UNIT;
        let mut legend_rows = Vec::new();
        if widths.iter().sum::<i32>() > beside {
            let mut used = PLOT_WIDTH;
            for width in widths {
                match legend_rows.last_mut() {
                    Some(row) if used + width <= PLOT_WIDTH => {
                        *row += 1;
                        used += width;
                    }
                    _ => {
                        legend_rows.push(1);
                        used = width;
                    }
                }
            }
        }
        let excess = events.len().saturating_sub(TEXT_ROWS);
        let mut hidden = 0;
        // The last events without a fault have no text, then the last faults.
        for is_fault in [false, true] {
            while hidden < excess
                && let Some(at) = events.iter().rposition(|event| event.is_fault == is_fault)
            {
                events.remove(at);
                hidden += 1;
            }
        }
        let units = f64::from(PLOT_WIDTH) / x.width();
        let groups = group(&events, NUMBER_WIDTH / units);
        Self { legend, legend_rows, groups, hidden, has_texts }
    }

    /// Lines of texts, each with the number of the first line of a group.
    fn lines(&self) -> Vec<(Option<usize>, String)> {
        if !self.has_texts {
            return Vec::new();
        }
        let mut lines = Vec::new();
        for (number, group) in (1..).zip(&self.groups) {
            let all =
                group.texts.iter().flat_map(|text| canvas::wrapped(text, PLOT_WIDTH - 24 * UNIT));
            lines.extend(all.enumerate().map(|(nth, line)| ((nth == 0).then_some(number), line)));
        }
        if self.hidden > 0 {
            lines.push((None, format!("and {} more events", self.hidden)));
        }
        lines
    }

    /// Height in units, beyond the line of the title, which the panel draws.
    pub fn height(&self) -> u32 {
        let numbers = if self.groups.is_empty() { 0 } else { NUMBERS };
        let rows = self.lines().len() as i32 * TEXT_ROW;
        (self.legend_rows.len() as i32 * LEGEND_ROW + rows + numbers).unsigned_abs()
    }

    /// Draws what is above the diagram, whose upper edge is at `top`.
    pub fn draw(&self, area: &Area<'_>, x: &Scale, top: i32) -> Result<(), PlotError> {
        let mut entries = self.legend.iter();
        let mut y = HEAD / 2;
        if self.legend_rows.is_empty() {
            let width: i32 = self.legend.iter().map(LegendEntry::width).sum();
            draw_entries(area, entries, (LEFT + PLOT_WIDTH - width, y))?;
            y = HEAD;
        } else {
            y += HEAD / 2;
            for count in &self.legend_rows {
                let row = entries.by_ref().take(*count);
                draw_entries(area, row, (LEFT, y + LEGEND_ROW / 2))?;
                y += LEGEND_ROW;
            }
        }
        for (number, line) in self.lines() {
            let middle = y + TEXT_ROW / 2;
            if let Some(number) = number {
                let at = (LEFT + 14 * UNIT, middle);
                text(area, &number.to_string(), at, 13, RED, (HPos::Right, VPos::Center))?;
            }
            text(area, &line, (LEFT + 22 * UNIT, middle), 13, TEXT, (HPos::Left, VPos::Center))?;
            y += TEXT_ROW;
        }
        for (number, group) in (1..).zip(&self.groups) {
            let style = (canvas::FONT, 12 * UNIT, FontStyle::Bold).into_font();
            let color = if group.is_fault { RED } else { TEXT };
            let style = style.color(&color).pos(Pos::new(HPos::Center, VPos::Bottom));
            let at = (x.map(&group.seconds, (LEFT, LEFT + PLOT_WIDTH)), top - 2 * UNIT);
            area.draw_text(&number.to_string(), &style, at).map_err(PlotError::draw)?;
        }
        Ok(())
    }
}

fn draw_entries<'a>(
    area: &Area<'_>,
    entries: impl Iterator<Item = &'a LegendEntry>,
    (mut left, middle): (i32, i32),
) -> Result<(), PlotError> {
    for entry in entries {
        entry.draw(area, (left, middle))?;
        left += entry.width();
    }
    Ok(())
}

/// Groups the events that follow the first one of their group within this time.
fn group(events: &[Event], seconds: f64) -> Vec<EventGroup> {
    let mut groups: Vec<EventGroup> = Vec::new();
    for event in events {
        match groups.last_mut() {
            Some(group) if event.seconds - group.seconds < seconds => {
                group.texts.push(event.text.clone());
                group.is_fault |= event.is_fault;
            }
            _ => groups.push(EventGroup {
                seconds: event.seconds,
                texts: vec![event.text.clone()],
                is_fault: event.is_fault,
            }),
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::canvas::AxisKind;
    use super::*;

    #[test]
    fn close_events_have_a_common_number() {
        let event = |seconds, is_fault| Event { seconds, text: seconds.to_string(), is_fault };
        let groups = group(&[event(1.0, false), event(1.1, true), event(2.0, false)], 0.5);
        assert_eq!(groups[0].texts, ["1", "1.1"]);
        assert!(groups[0].is_fault && !groups[1].is_fault && groups.len() == 2);
    }

    #[test]
    fn faults_are_listed_before_other_events() {
        let event =
            |nth: i32| Event { seconds: nth.into(), text: nth.to_string(), is_fault: nth == 39 };
        let x = Scale::new(0.0..40.0, 7, AxisKind::Linear);
        let head = |has_texts| {
            PanelHead::new("", Vec::new(), ((0..40).map(event).collect(), has_texts), &x)
        };
        let lines = head(true).lines();
        assert_eq!(lines.len(), TEXT_ROWS + 1);
        assert_eq!(lines[TEXT_ROWS - 1].1, "39");
        assert_eq!(lines[TEXT_ROWS].1, "and 28 more events");
        // The numbers of the other panels refer to the same list.
        assert!(head(false).lines().is_empty() && head(false).groups == head(true).groups);
    }

    #[test]
    fn legend_without_space_beside_the_title_has_its_own_lines() {
        let entry = |_| LegendEntry::new("a curve with a long name", Symbol::Break);
        let x = Scale::new(0.0..1.0, 7, AxisKind::Linear);
        let rows = |count: i32| {
            let legend = (0..count).map(entry).collect();
            PanelHead::new("title", legend, (Vec::new(), false), &x).legend_rows
        };
        assert_eq!(rows(3), Vec::<usize>::new());
        assert_eq!(rows(9), [4, 4, 1]);
    }
}
