//! The view of frames by gateway, channel, CAN ID and direction.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Cell, Paragraph, Table, TableState};

use super::super::id_text::{ID_TITLES, id_cells, id_summary, ids_title};
use super::super::keys::Choice;
use super::super::snapshot::{Direction, IdView, Snapshot};
use super::Tint;
use super::columns::Columns;
use crate::frames::signals::missing;

/// "FF " of a byte.
const BYTE_WIDTH: usize = 3;
/// Height of the table that the signals leave.
const LEAST_TABLE: u16 = 6;
/// Blanks between two signals of a line.
const GAP: usize = 3;

/// Lines of texts in columns, as many as there is room for; the last one counts the others.
fn columns_of(texts: Vec<String>, width: usize, room: usize) -> Vec<String> {
    let cell = texts.iter().map(|it| it.chars().count()).max().unwrap_or(0) + GAP;
    let per_line = ((width + GAP) / cell).max(1);
    let row = |texts: &[String]| {
        let cells: String = texts.iter().map(|it| format!("{it:cell$}")).collect();
        cells.trim_end().to_owned()
    };
    let lines: Vec<_> = texts.chunks(per_line).map(row).collect();
    if lines.len() <= room {
        return lines;
    }
    let shown = room.saturating_sub(1);
    let more = format!("{} more signals", texts.len() - (shown * per_line).min(texts.len()));
    lines.into_iter().take(shown).chain([more]).take(room).collect()
}

pub fn draw(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
    let rows = choice.ids(snapshot);
    let selected = choice.id.min(rows.len().saturating_sub(1));
    let per_line = (usize::from(area.width.saturating_sub(2)) / BYTE_WIDTH / 8).max(1) * 8;
    let bytes = rows.get(selected).map_or(0, |row| row.frame.data().len());
    let decoded = rows.get(selected).and_then(|it| snapshot.signals.decode(it.channel, &it.frame));
    // Border, summary and data.
    let data_lines = bytes.div_ceil(per_line).max(1) as u16;
    let room = area.height.saturating_sub(LEAST_TABLE + 3 + data_lines);
    let texts = decoded.iter().flat_map(|it| &it.signals).map(ToString::to_string).collect();
    let signal_lines = columns_of(texts, area.width.saturating_sub(2).into(), room.into());
    let detail = 3 + data_lines + signal_lines.len() as u16;
    let [table_area, detail_area] =
        Layout::vertical([Constraint::Min(LEAST_TABLE), Constraint::Length(detail)]).areas(area);
    draw_table(frame, table_area, snapshot, choice, (&rows, selected), tint);
    let block = Block::bordered();
    let mut lines = Vec::new();
    if let Some(row) = rows.get(selected) {
        let message = decoded.as_ref().map(|it| it.message.name.as_str());
        let missing = decoded.as_ref().map_or_else(String::new, missing);
        lines.push(Line::raw(id_summary(row, message) + &missing));
        let data: Vec<_> = row.frame.data().iter().enumerate().collect();
        lines.extend(data.chunks(per_line).map(|bytes| data_line(bytes, row, tint)));
        lines.extend(signal_lines.into_iter().map(Line::raw));
    }
    frame.render_widget(Paragraph::new(lines).block(block), detail_area);
}

fn draw_table(
    frame: &mut Frame,
    area: Rect,
    snapshot: &Snapshot,
    choice: Choice,
    (rows, selected): (&[&IdView], usize),
    tint: Tint,
) {
    const LEAST_DATA: u16 = 8;
    const WIDTHS: [u16; 9] = [4, 3, 8, 8, 8, 8, 3, 5, 0];
    let width = area.width.saturating_sub(2);
    let columns = std::array::from_fn(|at| (ID_TITLES[at], WIDTHS[at]));
    let columns =
        Columns::new(columns, [8, 0, 2, 1, 3, 4, 7, 6, 5], width.saturating_sub(LEAST_DATA));
    let room = columns.rest(width);
    // Border and titles.
    let visible = usize::from(area.height.saturating_sub(3)).max(1);
    let skipped = selected.saturating_sub(visible - 1);
    let shown = rows.iter().skip(skipped).take(visible).map(|row| {
        let [bus, direction, id, count, period, mean, dlc, age] = id_cells(row);
        let texts = [bus, direction, id, count, period, mean, dlc, age].map(Cell::from);
        let [a, b, c, d, e, f, g, h] = texts;
        let style = match row.direction {
            Direction::Failed => tint.of(Color::Red),
            Direction::Received | Direction::Sent => Style::new(),
        };
        columns.row([a, b, c, d, e, f, g, h, Cell::from(data_cell(row, room, tint))]).style(style)
    });
    let table = Table::new(shown, columns.widths())
        .header(columns.titles())
        .row_highlight_style(Modifier::REVERSED)
        .block(Block::bordered().title(ids_title(snapshot, choice, rows.len())));
    let mut state = TableState::new().with_selected(selected - skipped);
    frame.render_stateful_widget(table, area, &mut state);
}

/// The data, or their begin.
fn data_cell(row: &IdView, room: usize, tint: Tint) -> Line<'static> {
    let data: Vec<_> = row.frame.data().iter().enumerate().collect();
    if data.len() * BYTE_WIDTH <= room + 1 {
        return data_line(&data, row, tint);
    }
    let fitting = data.get(..room.saturating_sub(1) / BYTE_WIDTH).unwrap_or_default();
    let mut line = data_line(fitting, row, tint);
    line.push_span(Span::raw("…"));
    line
}

fn data_line(bytes: &[(usize, &u8)], row: &IdView, tint: Tint) -> Line<'static> {
    let changed = tint.of(Color::Yellow).add_modifier(Modifier::BOLD | Modifier::UNDERLINED);
    let spans = bytes.iter().flat_map(|(at, byte)| {
        let is_changed = row.changed >> at & 1 == 1;
        let style = if is_changed { changed } else { Style::new() };
        [Span::styled(format!("{byte:02X}"), style), Span::raw(" ")]
    });
    Line::from(spans.collect::<Vec<_>>())
}
