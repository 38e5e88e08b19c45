//! The view of axes.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph, Table, TableState, Wrap};

use ecan_service::protocol::AxisState;

use super::super::axis_text::{AXIS_TITLES, axis_cells, axis_details, is_heartbeat_lost};
use super::super::keys::Choice;
use super::super::snapshot::Snapshot;
use super::Tint;
use super::columns::Columns;

/// Border and lines of the selected axis.
const DETAIL_HEIGHT: u16 = 9;

pub fn draw(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
    let axes = &snapshot.axes.axes;
    let block = Block::bordered().title(format!("Axes: {}", axes.len()));
    if let Some(reason) = &snapshot.axes.without_axes {
        let text = Paragraph::new(reason.as_str()).wrap(Wrap { trim: true });
        frame.render_widget(text.block(block), area);
        return;
    }
    let [table_area, detail_area] =
        Layout::vertical([Constraint::Min(4), Constraint::Length(DETAIL_HEIGHT)]).areas(area);
    let selected = choice.axis.min(axes.len().saturating_sub(1));
    const WIDTHS: [u16; 10] = [4, 4, 0, 4, 11, 11, 9, 9, 6, 30];
    const LEAST_PHASE: u16 = 14;
    let columns = std::array::from_fn(|at| (AXIS_TITLES[at], WIDTHS[at]));
    let room = area.width.saturating_sub(2 + LEAST_PHASE);
    let columns = Columns::new(columns, [2, 0, 1, 4, 5, 6, 7, 3, 8, 9], room);
    let rows = axes.iter().map(|axis| columns.row(axis_cells(axis)).style(style(axis, tint)));
    let table = Table::new(rows, columns.widths())
        .header(columns.titles())
        .row_highlight_style(Modifier::REVERSED)
        .block(block);
    let mut state = TableState::new().with_selected(selected);
    frame.render_stateful_widget(table, table_area, &mut state);
    let Some(axis) = axes.get(selected) else { return };
    let lines: Vec<_> = axis_details(axis).into_iter().map(Line::raw).collect();
    let text = Paragraph::new(lines).wrap(Wrap { trim: true }).block(Block::bordered());
    let text = text.style(style(axis, tint));
    frame.render_widget(text, detail_area);
}

fn style(axis: &AxisState, tint: Tint) -> Style {
    if axis.error.is_some() || axis.error_code != 0 {
        tint.of(Color::Red).add_modifier(Modifier::BOLD)
    } else if axis.hold_reason.is_some() || is_heartbeat_lost(axis) {
        tint.of(Color::Yellow)
    } else if axis.is_running {
        tint.of(Color::Green)
    } else {
        Style::new()
    }
}
