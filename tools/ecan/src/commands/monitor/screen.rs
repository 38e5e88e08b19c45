//! Draws a snapshot. A pure function of the snapshot and the user's selection.

use ecan_protocol::mapping::CHANNELS;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Clear, Paragraph};

use super::keys::{Choice, View};
use super::snapshot::{GatewayState, Snapshot};
use super::views::{Tint, draw_axes, draw_ids, draw_overview, has_problem, latest_events};

/// Minimum size of the full screen; below, only problems are shown.
const LEAST_WIDTH: u16 = 54;
const LEAST_HEIGHT: u16 = 14;
/// Minimum number of free lines before events are shown.
const LEAST_EVENTS: usize = 4;
const HELP: &str = "\
q, Esc, Ctrl-C  end
1, 2, 3         overview, CAN IDs, axes
p               pause and continue
c               clear counters
up, down        select a row; also PgUp,
                PgDn, Home, End
left, right     select a channel; CAN IDs:
                of all, one channel
s               CAN IDs: next order
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
        let width = 44.min(area.width);
        let height = 12.min(area.height);
        let popup = Rect::new((area.width - width) / 2, (area.height - height) / 2, width, height);
        frame.render_widget(Clear, popup);
        frame.render_widget(Paragraph::new(HELP).block(Block::bordered().title("Keys")), popup);
    }
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
    lines.extend(snapshot.head.interruption.map(Line::raw));
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
        let mark = if snapshot.head.is_simulated { "SIMULATED  " } else { "" };
        lines.push(Line::raw(format!("{mark}q end  ? help")));
    }
    frame.render_widget(Paragraph::new(lines), area);
}

fn draw_whole(frame: &mut Frame, area: Rect, snapshot: &Snapshot, choice: Choice, tint: Tint) {
    let [title_area, view_area, key_area] =
        Layout::vertical([Constraint::Length(1), Constraint::Min(0), Constraint::Length(1)])
            .areas(area);
    frame.render_widget(title(snapshot, choice, tint), title_area);
    match choice.view {
        View::Overview => draw_overview(frame, view_area, snapshot, choice, tint),
        View::Ids => draw_ids(frame, view_area, snapshot, choice, tint),
        View::Axes => draw_axes(frame, view_area, snapshot, choice, tint),
    }
    frame.render_widget(Paragraph::new(keys(choice.view)), key_area);
}

fn keys(view: View) -> &'static str {
    match view {
        View::Overview => "q end  ? help  2 CAN IDs  3 axes  p pause  c clear  arrows select",
        View::Ids => "q end  ? help  1 overview  3 axes  s sort  p pause  c clear  arrows select",
        View::Axes => "q end  ? help  1 overview  2 CAN IDs  p pause  c clear  arrows select",
    }
}

fn title(snapshot: &Snapshot, choice: Choice, tint: Tint) -> Paragraph<'static> {
    let head = &snapshot.head;
    let ready = snapshot.gateways.iter().filter(|gateway| gateway.state == GatewayState::Ready);
    let mut words = format!(
        "ecan monitor  {} of {} ready  {:.0} s",
        ready.count(),
        snapshot.gateways.len(),
        head.seconds
    );
    if head.is_simulated {
        words.push_str("  SIMULATED");
    }
    let mut spans = vec![Span::styled(words, Modifier::BOLD)];
    let mut mark = |words: String, style: Style| {
        spans.push(Span::raw("  "));
        spans.push(Span::styled(words, style));
    };
    if choice.is_paused {
        mark("PAUSED".to_owned(), Modifier::REVERSED.into());
    }
    if let Some(interruption) = head.interruption {
        mark(interruption.to_owned(), Modifier::REVERSED.into());
    }
    if head.frames_lost > 0 {
        mark(format!("{} frames lost here", head.frames_lost), tint.of(Color::Red));
    }
    if let Some(program) = &head.program {
        mark(format!("via {program}"), Style::new());
    }
    Paragraph::new(Line::from(spans))
}

#[cfg(test)]
#[path = "screen_tests.rs"]
mod tests;
