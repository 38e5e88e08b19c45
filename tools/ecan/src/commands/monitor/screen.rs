//! Draws a snapshot. A pure function of the snapshot and the user's selection.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Cell, Clear, Paragraph, Row, Table, TableState};

use ecan_protocol::mapping::CHANNELS;

use super::keys::Choice;
use super::snapshot::{CLASS_NAMES, CLASSES, ChannelView, GatewayState, GatewayView, Snapshot};
use super::text::{CHANNEL_TITLES, channel_cells, cycle_counts, cycle_times, gateway_cells};

/// Minimum height of the full screen; below, only problems are shown.
const LEAST_WIDTH: u16 = 54;
const LEAST_HEIGHT: u16 = 14;
/// Minimum number of free lines before events are shown.
const LEAST_EVENTS: usize = 4;
/// Border, titles and one gateway.
const LEAST_GATEWAYS: u16 = 4;
/// Border and titles of the channels, and the line of the selected one.
const CHANNELS_HEIGHT: u16 = CHANNELS as u16 + 4;
const CYCLE_HEIGHT: u16 = 6;
const HISTOGRAM_HEIGHT: u16 = CLASSES as u16 + 2;
const HELP: &str = "\
q, Esc, Ctrl-C  end
p               pause and continue
c               clear counters
up, down        select a gateway
left, right     select a channel
?               close this help";

pub fn draw(frame: &mut Frame, snapshot: &Snapshot, choice: Choice, has_color: bool) {
    let area = frame.area();
    let tint = Tint(has_color);
    if area.width < LEAST_WIDTH || area.height < LEAST_HEIGHT {
        draw_tiny(frame, area, snapshot, choice, tint);
    } else {
        draw_whole(frame, area, snapshot, choice, tint);
    }
    if choice.has_help {
        let width = 36.min(area.width);
        let height = 8.min(area.height);
        let popup = Rect::new((area.width - width) / 2, (area.height - height) / 2, width, height);
        frame.render_widget(Clear, popup);
        frame.render_widget(Paragraph::new(HELP).block(Block::bordered().title("Keys")), popup);
    }
}

#[derive(Clone, Copy)]
struct Tint(bool);

impl Tint {
    fn of(self, color: Color) -> Style {
        if self.0 { Style::new().fg(color) } else { Style::new() }
    }

    fn gateway(self, gateway: &GatewayView) -> Style {
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

fn has_problem(gateway: &GatewayView) -> bool {
    gateway.channels.iter().any(|channel| channel.is_bus_off || channel.has_warning)
}

/// One line per gateway, those with problems first; the remaining lines show the keys and the
/// latest events.
fn draw_tiny(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
    let mut gateways: Vec<_> = snapshot.gateways.iter().collect();
    gateways.sort_by_key(|gateway| (gateway.state == GatewayState::Ready, !has_problem(gateway)));
    let mut lines: Vec<Line> = Vec::new();
    if choice.is_paused {
        lines.push(Line::raw("PAUSED"));
    }
    lines.extend(gateways.into_iter().map(|gateway| {
        let off = (0..CHANNELS).zip(&gateway.channels).filter(|(_, channel)| channel.is_bus_off);
        let off: String = off.map(|(at, _)| format!(" can{at}")).collect();
        let words = match off.as_str() {
            "" => format!("{} {}", gateway.position, gateway.state.text()),
            off => format!("{} bus-off{off}", gateway.position),
        };
        Line::styled(words, tint.gateway(gateway))
    }));
    let mut left = usize::from(area.height).saturating_sub(lines.len());
    if left >= LEAST_EVENTS {
        // Between a blank line and the keys.
        let events = latest_events(snapshot, left - 2);
        left -= 1 + events.len();
        lines.push(Line::default());
        lines.extend(events);
    }
    if left > 0 {
        lines.extend(std::iter::repeat_n(Line::default(), left - 1));
        let mark = if snapshot.is_simulated { "SIMULATED  " } else { "" };
        lines.push(Line::raw(format!("{mark}q end  ? help")));
    }
    frame.render_widget(Paragraph::new(lines), area);
}

fn draw_whole(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
    // Without title and keys. One gateway and its channels are always shown.
    let room = area.height - 2;
    let needed = u16::try_from(snapshot.gateways.len()).unwrap_or(u16::MAX).saturating_add(3);
    let others = CHANNELS_HEIGHT + CYCLE_HEIGHT;
    let gateways = needed.min(room.saturating_sub(others).max(LEAST_GATEWAYS));
    let mut left = room.saturating_sub(gateways);
    let mut take = |height: u16| {
        let taken = if left >= height { height } else { 0 };
        left -= taken;
        taken
    };
    let (channels, cycle, histogram) =
        (take(CHANNELS_HEIGHT), take(CYCLE_HEIGHT), take(HISTOGRAM_HEIGHT));
    let [title_area, gateway_area, channel_area, cycle_area, histogram_area, event_area, key_area] =
        Layout::vertical([
            Constraint::Length(1),
            Constraint::Length(gateways),
            Constraint::Length(channels),
            Constraint::Length(cycle),
            Constraint::Length(histogram),
            Constraint::Min(0),
            Constraint::Length(1),
        ])
        .areas(area);
    frame.render_widget(title(snapshot, choice), title_area);
    draw_gateways(frame, gateway_area, snapshot, choice, tint);
    draw_channels(frame, channel_area, snapshot, choice, tint);
    draw_cycle(frame, cycle_area, snapshot);
    draw_histogram(frame, histogram_area, snapshot);
    draw_events(frame, event_area, snapshot);
    let keys = "q end  p pause  c clear  arrows select  ? help";
    frame.render_widget(Paragraph::new(keys), key_area);
}

fn title(snapshot: &Snapshot, choice: Choice) -> Paragraph<'static> {
    let ready = snapshot.gateways.iter().filter(|it| it.state == GatewayState::Ready);
    let mut words = format!(
        "ecan monitor  {} of {} ready  {:.0} s",
        ready.count(),
        snapshot.gateways.len(),
        snapshot.seconds
    );
    if snapshot.is_simulated {
        words.push_str("  SIMULATED");
    }
    let mut spans = vec![Span::styled(words, Modifier::BOLD)];
    if choice.is_paused {
        spans.push(Span::raw("  "));
        spans.push(Span::styled("PAUSED", Modifier::REVERSED));
    }
    Paragraph::new(Line::from(spans))
}

/// Table that omits the columns at the right that do not fit.
fn columns<const N: usize>(widths: [u16; N], room: u16) -> Vec<Constraint> {
    let mut used = 0;
    let fits = |width: &u16| {
        used += width + 1;
        used <= room + 1
    };
    widths.into_iter().take_while(fits).map(Constraint::Length).collect()
}

const REASON_WIDTH: u16 = 15;

fn draw_gateways(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
    const TITLES: [&str; 8] =
        ["#", "state", "WC", "incompl.", "lost img.", "faulty", "lost", "reason"];
    let mut widths = columns([3, 10, 5, 8, 9, 6, 4], area.width.saturating_sub(2 + REASON_WIDTH));
    let shown = widths.len();
    widths.push(Constraint::Min(0));
    let rows = snapshot.gateways.iter().map(|gateway| {
        let [position, state, wc, incomplete, images, _, faulty, lost, reason] =
            gateway_cells(gateway);
        let images = if gateway.unknown_images > 0 { format!("{images} + ?") } else { images };
        let cells = [position, state, wc, incomplete, images, faulty, lost].map(Cell::from);
        let cells = cells.into_iter().take(shown).chain([Cell::from(reason)]);
        Row::new(cells).style(tint.gateway(gateway))
    });
    let titles = TITLES.into_iter().take(shown).chain(["reason"]);
    let table = Table::new(rows, widths)
        .header(Row::new(titles).style(Modifier::BOLD))
        .row_highlight_style(Modifier::REVERSED)
        .block(Block::bordered().title("Gateways"));
    let mut state = TableState::new().with_selected(choice.gateway);
    frame.render_stateful_widget(table, area, &mut state);
}

fn draw_channels(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
    let Some(gateway) = snapshot.gateways.get(choice.gateway) else { return };
    let block = Block::bordered().title(format!("Channels of gateway {}", gateway.position));
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let [table_area, detail_area] =
        Layout::vertical([Constraint::Min(0), Constraint::Length(1)]).areas(inner);
    let widths = columns([7, 12, 7, 9, 3, 3, 10, 9, 8, 10], inner.width);
    let rows = gateway
        .channels
        .iter()
        .enumerate()
        .map(|(at, channel)| Row::new(channel_cells(at, channel)).style(tint.channel(channel)));
    let table = Table::new(rows, widths)
        .header(Row::new(CHANNEL_TITLES).style(Modifier::BOLD))
        .row_highlight_style(Modifier::REVERSED);
    let mut state = TableState::new().with_selected(choice.channel);
    frame.render_stateful_widget(table, table_area, &mut state);
    if let Some(channel) = gateway.channels.get(choice.channel) {
        let words = format!("can{}: {}", choice.channel, in_words(channel));
        frame.render_widget(Paragraph::new(words).style(tint.channel(channel)), detail_area);
    }
}

fn in_words(channel: &ChannelView) -> String {
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
    let block = Block::bordered().title(format!("Cycle {} us", cycle.cycle_us));
    frame.render_widget(Paragraph::new(lines.collect::<Vec<_>>()).block(block), area);
}

fn draw_histogram(frame: &mut Frame, area: Rect, snapshot: &Snapshot) {
    let counts = snapshot.cycle.histogram;
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

fn draw_events(frame: &mut Frame, area: Rect, snapshot: &Snapshot) {
    let room = usize::from(area.height.saturating_sub(2));
    if room == 0 {
        return;
    }
    let block = Block::bordered().title("Events");
    frame.render_widget(Paragraph::new(latest_events(snapshot, room)).block(block), area);
}

fn latest_events(snapshot: &Snapshot, room: usize) -> Vec<Line<'_>> {
    let skipped = snapshot.events.len().saturating_sub(room);
    let events = snapshot.events.iter().skip(skipped);
    events.map(|it| Line::raw(format!("{:8.1} s  {}", it.seconds, it.words))).collect()
}

#[cfg(test)]
#[path = "screen_tests.rs"]
mod tests;
