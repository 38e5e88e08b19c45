//! The view of gateways, channels, cycle and events.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::Modifier;
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph, Row, Table, TableState};

use ecan_protocol::mapping::CHANNELS;
use ecan_service::protocol::ServiceStats;

use super::super::keys::Choice;
use super::super::snapshot::{CLASS_NAMES, CLASSES, ChannelView, Snapshot};
use super::super::text::{
    CHANNEL_TITLES, CLIENT_TITLES, channel_cells, client_cells, cycle_counts, cycle_times,
    cycle_title, gateway_cells, ring_losses,
};
use super::columns::Columns;
use super::{Tint, latest_events};

/// Border, titles and one gateway.
const LEAST_GATEWAYS: u16 = 4;
/// Border and titles of the channels, and the line of the selected one.
const CHANNELS_HEIGHT: u16 = CHANNELS as u16 + 4;
const CYCLE_HEIGHT: u16 = 6;
const HISTOGRAM_HEIGHT: u16 = CLASSES as u16 + 2;
const MAX_CLIENTS: usize = 8;

pub fn draw(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
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
