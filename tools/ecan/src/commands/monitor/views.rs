//! The views of the screen: gateways with channels, cycle and events; CAN IDs; axes.

use ecan_protocol::mapping::CHANNELS;
use ecan_service::protocol::{AxisState, ServiceStats};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Cell, Paragraph, Row, Table, TableState, Wrap};

use super::keys::Choice;
use super::snapshot::{
    CLASS_NAMES, CLASSES, ChannelView, Direction, GatewayState, GatewayView, IdView, Snapshot,
};
use super::text::{
    CHANNEL_TITLES, CLIENT_TITLES, channel_cells, client_cells, cycle_counts, cycle_times,
    cycle_title, gateway_cells, ring_losses,
};
use crate::commands::monitor::text::{
    AXIS_TITLES, ID_TITLES, axis_cells, axis_details, id_cells, id_summary, ids_title,
    is_heartbeat_lost,
};
use crate::frames::signals::missing;

/// Border, titles and one gateway.
const LEAST_GATEWAYS: u16 = 4;
/// Border and titles of the channels, and the line of the selected one.
const CHANNELS_HEIGHT: u16 = CHANNELS as u16 + 4;
const CYCLE_HEIGHT: u16 = 6;
const HISTOGRAM_HEIGHT: u16 = CLASSES as u16 + 2;
const MAX_CLIENTS: usize = 8;

pub fn draw_overview(
    frame: &mut Frame,
    area: Rect,
    snapshot: &Snapshot,
    choice: Choice,
    tint: Tint,
) {
    // One gateway and its channels are always shown.
    let room = area.height;
    let needed = u16::try_from(snapshot.gateways.len()).unwrap_or(u16::MAX).saturating_add(3);
    let others = CHANNELS_HEIGHT + CYCLE_HEIGHT;
    let gateways = needed.min(room.saturating_sub(others).max(LEAST_GATEWAYS));
    let mut left = room.saturating_sub(gateways);
    let mut take = |height: u16| {
        let taken = if left >= height { height } else { 0 };
        left -= taken;
        taken
    };
    // Border and titles.
    let clients = |stats: &ServiceStats| stats.clients.len().min(MAX_CLIENTS) as u16 + 3;
    let last = snapshot.service.as_ref().map_or(HISTOGRAM_HEIGHT, clients);
    let (channels, cycle, last) = (take(CHANNELS_HEIGHT), take(CYCLE_HEIGHT), take(last));
    let [gateway_area, channel_area, cycle_area, last_area, event_area] = Layout::vertical([
        Constraint::Length(gateways),
        Constraint::Length(channels),
        Constraint::Length(cycle),
        Constraint::Length(last),
        Constraint::Min(0),
    ])
    .areas(area);
    draw_gateways(frame, gateway_area, snapshot, choice, tint);
    draw_channels(frame, channel_area, snapshot, choice, tint);
    draw_cycle(frame, cycle_area, snapshot);
    match &snapshot.service {
        Some(stats) => draw_clients(frame, last_area, snapshot, stats),
        None => draw_histogram(frame, last_area, snapshot),
    }
    draw_events(frame, event_area, snapshot);
}

fn draw_gateways(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
    // Before the rest for the reason.
    const LEAST_REASON: u16 = 15;
    let columns = [
        ("#", 3),
        ("state", 10),
        ("WC", 5),
        ("incompl.", 8),
        ("lost img.", 9),
        ("faulty", 6),
        ("lost", 4),
        ("reason", 0),
    ];
    let room = area.width.saturating_sub(1 + LEAST_REASON);
    let columns = Columns::new(columns, [7, 0, 1, 2, 3, 4, 5, 6], room);
    let rows = snapshot.gateways.iter().map(|gateway| {
        let [position, state, wc, incomplete, images, _, faulty, lost, reason] =
            gateway_cells(gateway);
        let images = if gateway.unknown_images > 0 { format!("{images} + ?") } else { images };
        let cells = [position, state, wc, incomplete, images, faulty, lost, reason];
        columns.row(cells).style(tint.gateway(gateway))
    });
    let table = Table::new(rows, columns.widths())
        .header(columns.titles())
        .row_highlight_style(Modifier::REVERSED)
        .block(Block::bordered().title("Gateways"));
    let mut state = TableState::new().with_selected(choice.gateway);
    frame.render_stateful_widget(table, area, &mut state);
}

fn draw_channels(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
    const WIDTHS: [u16; 10] = [7, 12, 7, 9, 3, 3, 10, 9, 8, 10];
    // "received" before the error counters; the line of the selected channel has the pending frames.
    const PENDING: usize = 6;
    const PRIORITY: [usize; 10] = [0, 1, 2, 3, 9, 4, 5, 7, 8, PENDING];
    let Some(gateway) = snapshot.gateways.get(choice.gateway) else { return };
    let block = Block::bordered().title(format!("Channels of gateway {}", gateway.position));
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let [table_area, detail_area] =
        Layout::vertical([Constraint::Min(0), Constraint::Length(1)]).areas(inner);
    let columns = std::array::from_fn(|at| (CHANNEL_TITLES[at], WIDTHS[at]));
    let columns = Columns::new(columns, PRIORITY, inner.width);
    let rows =
        gateway.channels.iter().enumerate().map(|(at, channel)| {
            columns.row(channel_cells(at, channel)).style(tint.channel(channel))
        });
    let table = Table::new(rows, columns.widths())
        .header(columns.titles())
        .row_highlight_style(Modifier::REVERSED);
    let mut state = TableState::new().with_selected(choice.channel);
    frame.render_stateful_widget(table, table_area, &mut state);
    if let Some(channel) = gateway.channels.get(choice.channel) {
        let mut words = format!("can{}: {}", choice.channel, status_text(channel));
        if !columns.contains(PENDING) && channel.state.is_some() {
            let [.., pending, _, _, _] = channel_cells(0, channel);
            words.push_str(&format!(", rx/tx wait {pending}"));
        }
        frame.render_widget(Paragraph::new(words).style(tint.channel(channel)), detail_area);
    }
}

fn status_text(channel: &ChannelView) -> String {
    let Some(state) = &channel.state else { return "the gateway is not ready".to_owned() };
    let mut words = state.clone();
    let marks = [
        (channel.has_warning, "error warning, error passive or degraded bus"),
        (channel.has_rx_pressure, "receive buffer nearly full"),
        (channel.has_tx_pressure, "transmit buffer congested"),
    ];
    for (_, mark) in marks.into_iter().filter(|(is_set, _)| *is_set) {
        words.push_str(", ");
        words.push_str(mark);
    }
    words
}

fn draw_cycle(frame: &mut Frame, area: Rect, snapshot: &Snapshot) {
    let cycle = &snapshot.cycle;
    let lines = [cycle_counts(cycle)].into_iter().chain(cycle_times(cycle)).map(Line::raw);
    let block = Block::bordered().title(format!("Cycle {}", cycle_title(cycle)));
    frame.render_widget(Paragraph::new(lines.collect::<Vec<_>>()).block(block), area);
}

fn draw_histogram(frame: &mut Frame, area: Rect, snapshot: &Snapshot) {
    let Some(counts) = snapshot.cycle.histogram else { return };
    let all = counts.iter().sum::<u64>().max(1);
    // Name, count and bar.
    let room = u64::from(area.width.saturating_sub(2 + 10 + 1 + 12 + 1));
    let lines = CLASS_NAMES.iter().zip(counts).map(|(name, count)| {
        // At least one block for a count above 0.
        let length = (count.saturating_mul(room) / all).max(u64::from(count > 0));
        let bar: String = std::iter::repeat_n('█', length as usize).collect();
        Line::raw(format!("{name:>10} {count:>12} {bar}"))
    });
    let block = Block::bordered().title("Period minus cycle, us");
    frame.render_widget(Paragraph::new(lines.collect::<Vec<_>>()).block(block), area);
}

fn draw_clients(frame: &mut Frame, area: Rect, snapshot: &Snapshot, stats: &ServiceStats) {
    let program = snapshot.head.program.as_deref().unwrap_or_default();
    let title = format!("Clients of {program}{}", ring_losses(stats));
    let widths = [16, 8, 7, 10, 9, 8, 8, 7];
    let columns = std::array::from_fn(|at| (CLIENT_TITLES[at], widths[at]));
    let columns = Columns::new(columns, [0, 1, 2, 3, 4, 5, 6, 7], area.width.saturating_sub(2));
    let rows = stats.clients.iter().map(|client| columns.row(client_cells(client)));
    let rows: Vec<Row> = rows.collect();
    let table = Table::new(rows, columns.widths())
        .header(columns.titles())
        .block(Block::bordered().title(title));
    frame.render_widget(table, area);
}

fn draw_events(frame: &mut Frame, area: Rect, snapshot: &Snapshot) {
    let room = usize::from(area.height.saturating_sub(2));
    if room == 0 {
        return;
    }
    let block = Block::bordered().title("Events");
    frame.render_widget(Paragraph::new(latest_events(snapshot, room)).block(block), area);
}

/// "FF " of a byte.
const BYTE_WIDTH: usize = 3;
/// Height of the table that the signals leave.
const LEAST_TABLE: u16 = 6;
/// Blanks between two signals of a line.
const GAP: usize = 3;

/// Lines of texts in columns, as many as there is room for; the last one counts the others.
fn columns_of(texts: Vec<String>, width: usize, room: usize) -> Vec<String> {
    let cell = texts.iter().map(|text| text.chars().count()).max().unwrap_or(0) + GAP;
    let per_line = ((width + GAP) / cell).max(1);
    let row = |texts: &[String]| {
        let cells: String = texts.iter().map(|cell_text| format!("{cell_text:cell$}")).collect();
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

pub fn draw_ids(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
    let rows = choice.ids(snapshot);
    let selected = choice.id.min(rows.len().saturating_sub(1));
    let per_line = (usize::from(area.width.saturating_sub(2)) / BYTE_WIDTH / 8).max(1) * 8;
    let bytes = rows.get(selected).map_or(0, |row| row.frame.data().len());
    let decoded =
        rows.get(selected).and_then(|row| snapshot.signals.decode(row.channel, &row.frame));
    // Border, summary and data.
    let data_lines = bytes.div_ceil(per_line).max(1) as u16;
    let room = area.height.saturating_sub(LEAST_TABLE + 3 + data_lines);
    let texts = decoded.iter().flat_map(|frame| &frame.signals).map(ToString::to_string).collect();
    let signal_lines = columns_of(texts, area.width.saturating_sub(2).into(), room.into());
    let detail = 3 + data_lines + signal_lines.len() as u16;
    let [table_area, detail_area] =
        Layout::vertical([Constraint::Min(LEAST_TABLE), Constraint::Length(detail)]).areas(area);
    draw_table(frame, table_area, snapshot, choice, (&rows, selected), tint);
    let block = Block::bordered();
    let mut lines = Vec::new();
    if let Some(row) = rows.get(selected) {
        let message = decoded.as_ref().map(|frame| frame.message.name.as_str());
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

/// Border and lines of the selected axis.
const DETAIL_HEIGHT: u16 = 9;

pub fn draw_axes(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
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
    let rows = axes.iter().map(|axis| columns.row(axis_cells(axis)).style(axis_style(axis, tint)));
    let table = Table::new(rows, columns.widths())
        .header(columns.titles())
        .row_highlight_style(Modifier::REVERSED)
        .block(block);
    let mut state = TableState::new().with_selected(selected);
    frame.render_stateful_widget(table, table_area, &mut state);
    let Some(axis) = axes.get(selected) else { return };
    let lines: Vec<_> = axis_details(axis).into_iter().map(Line::raw).collect();
    let text = Paragraph::new(lines).wrap(Wrap { trim: true }).block(Block::bordered());
    let text = text.style(axis_style(axis, tint));
    frame.render_widget(text, detail_area);
}

fn axis_style(axis: &AxisState, tint: Tint) -> Style {
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

/// Columns that are shown, in their order.
pub struct Columns<const N: usize> {
    shown: Vec<usize>,
    widths: [u16; N],
    titles: [&'static str; N],
}

impl<const N: usize> Columns<N> {
    /// Columns by title and width; the first ones in `priority` that fit are shown. A width of 0 takes
    /// the rest.
    pub fn new(columns: [(&'static str, u16); N], priority: [usize; N], room: u16) -> Self {
        let (titles, widths) = (columns.map(|column| column.0), columns.map(|column| column.1));
        let mut used = 0;
        let fits = |column: &usize| {
            used += widths.get(*column).copied().unwrap_or_default() + 1;
            used <= room + 1
        };
        let mut shown: Vec<_> = priority.into_iter().take_while(fits).collect();
        shown.sort_unstable();
        Self { shown, widths, titles }
    }

    /// Returns whether a column is shown.
    pub fn contains(&self, column: usize) -> bool {
        self.shown.contains(&column)
    }

    /// Width of the column that takes the rest.
    pub fn rest(&self, width: u16) -> usize {
        let others = self.shown(&self.widths).filter(|width| **width > 0);
        width.saturating_sub(others.map(|width| width + 1).sum()).into()
    }

    pub fn widths(&self) -> Vec<Constraint> {
        let constraint = |width: u16| match width {
            0 => Constraint::Min(0),
            width => Constraint::Length(width),
        };
        self.shown(&self.widths).map(|width| constraint(*width)).collect()
    }

    pub fn titles(&self) -> Row<'static> {
        let titles: Vec<_> = self.shown(&self.titles).map(|title| Cell::from(*title)).collect();
        Row::new(titles).style(Modifier::BOLD)
    }

    pub fn row<'a, C: Clone + Into<Cell<'a>>>(&self, cells: [C; N]) -> Row<'a> {
        Row::new(self.shown(&cells).map(|cell| cell.clone().into()).collect::<Vec<_>>())
    }

    fn shown<'a, T>(&'a self, items: &'a [T; N]) -> impl Iterator<Item = &'a T> {
        self.shown.iter().filter_map(|at| items.get(*at))
    }
}

#[derive(Clone, Copy)]
pub struct Tint(pub bool);

impl Tint {
    pub fn of(self, color: Color) -> Style {
        if self.0 { Style::new().fg(color) } else { Style::new() }
    }

    pub fn gateway(self, gateway: &GatewayView) -> Style {
        match gateway.state {
            GatewayState::Ready if !has_problem(gateway) => self.of(Color::Green),
            GatewayState::Ready | GatewayState::Starting => self.of(Color::Yellow),
            GatewayState::Lost => self.of(Color::Red).add_modifier(Modifier::BOLD),
        }
    }

    fn channel(self, channel: &ChannelView) -> Style {
        if channel.is_bus_off {
            self.of(Color::Red).add_modifier(Modifier::BOLD)
        } else if channel.has_warning || channel.has_rx_pressure || channel.has_tx_pressure {
            self.of(Color::Yellow)
        } else {
            Style::new()
        }
    }
}

pub fn has_problem(gateway: &GatewayView) -> bool {
    gateway.channels.iter().any(|channel| channel.is_bus_off || channel.has_warning)
}

pub fn latest_events(snapshot: &Snapshot, room: usize) -> Vec<Line<'_>> {
    let skipped = snapshot.events.len().saturating_sub(room);
    let events = snapshot.events.iter().skip(skipped);
    events.map(|event| Line::raw(format!("{:8.1} s  {}", event.seconds, event.words))).collect()
}
