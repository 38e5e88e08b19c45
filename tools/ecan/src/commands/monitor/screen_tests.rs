//! Tests of the screens as text.

use ratatui::Terminal;
use ratatui::backend::TestBackend;

use super::super::keys::Sort;
use super::super::test_snapshots::{
    axes, bus_off, healthy, ids, lost, through_service, with_signals,
};
use super::*;
use crate::frames::Channels;

/// Text of the screen, without trailing blanks.
fn screen(width: u16, height: u16, snapshot: &Snapshot, choice: Choice) -> String {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw(frame, snapshot, choice, true)).unwrap();
    let buffer = terminal.backend().buffer();
    let row = |y| -> String { (0..width).map(|x| buffer[(x, y)].symbol()).collect() };
    (0..height).map(|y| format!("{}\n", row(y).trim_end())).collect()
}

/// Colour at the first occurrence of a text.
fn color(snapshot: &Snapshot, words: &str, has_color: bool) -> Color {
    let mut terminal = Terminal::new(TestBackend::new(100, 30)).unwrap();
    let choice = Choice { channel: 3, ..Choice::default() };
    terminal.draw(|frame| draw(frame, snapshot, choice, has_color)).unwrap();
    let buffer = terminal.backend().buffer();
    for y in 0..30 {
        let row: Vec<_> = (0..100).map(|x| buffer[(x, y)].symbol()).collect();
        if let Some(at) = row.concat().find(words) {
            let before = &row.concat()[..at];
            return buffer[(before.chars().count() as u16, y)].fg;
        }
    }
    panic!("{words} is not on the screen");
}

/// Compares a screen with its file.
macro_rules! shows {
    ($name:literal, $size:expr, $snapshot:expr, $choice:expr) => {
        let (width, height) = $size;
        let shown = screen(width, height, &$snapshot, $choice);
        let expected = include_str!(concat!("expected/", $name, ".txt"));
        assert_eq!(shown, expected, "{}:\n{shown}", $name);
    };
}

const FIRST: Choice = Choice {
    view: View::Overview,
    gateway: 0,
    channel: 0,
    id: 0,
    sort: Sort::Id,
    filter: Channels::ALL,
    axis: 0,
    is_paused: false,
    has_help: false,
};

#[test]
fn healthy_gateway_screen() {
    shows!("healthy", (100, 34), healthy(1), FIRST);
}

#[test]
fn bus_off_and_full_buffers_screen() {
    let mut snapshot = bus_off();
    snapshot.gateways[0].channels[2].has_warning = true;
    snapshot.gateways[0].channels[2].has_rx_pressure = true;
    shows!("bus_off", (100, 20), snapshot, Choice { channel: 2, ..FIRST });
    assert_eq!(color(&snapshot, "can1    bus-off", true), Color::Red);
    assert_eq!(color(&snapshot, "can2    run, warning", true), Color::Yellow);
}

#[test]
fn lost_gateway_screen() {
    shows!("lost", (100, 25), lost(), Choice { gateway: 1, ..FIRST });
    assert_eq!(color(&lost(), "LOST", true), Color::Red);
    assert_eq!(color(&lost(), "LOST", false), Color::Reset);
    assert_eq!(color(&healthy(1), "ready      3/3", true), Color::Green);
}

#[test]
fn narrow_terminal_omits_columns() {
    shows!("narrow", (56, 24), lost(), FIRST);
}

#[test]
fn tiny_terminal_shows_problems_first() {
    assert_eq!(screen(20, 2, &lost(), FIRST), "1 LOST\n0 ready\n");
    assert_eq!(screen(26, 2, &bus_off(), FIRST), "0 bus-off can1\nSIMULATED  q end  ? help\n");
    let mut real = bus_off();
    real.head.is_simulated = false;
    assert_eq!(screen(26, 3, &real, FIRST), "0 bus-off can1\n\nq end  ? help\n");
    let expected = "\
1 LOST
0 ready

     0.9 s  gateway 0: ready
    60.9 s  gateway 1: lost

SIMULATED  q end  ? help
";
    assert_eq!(screen(40, 7, &lost(), FIRST), expected);
    let paused = Choice { is_paused: true, ..FIRST };
    assert_eq!(screen(20, 2, &lost(), paused), "PAUSED\n1 LOST\n");
    let mut old = lost();
    old.head.interruption = Some("NO RESPONSE");
    assert_eq!(screen(20, 2, &old, FIRST), "NO RESPONSE\n1 LOST\n");
}

#[test]
fn any_size_can_be_drawn() {
    let help = Choice { has_help: true, gateway: 19, channel: 3, is_paused: true, ..FIRST };
    let last = Choice { id: usize::MAX, axis: usize::MAX, ..FIRST };
    let choices = [View::Overview, View::Ids, View::Axes].map(|view| Choice { view, ..last });
    let (signals, service) = (with_signals(ids()), through_service());
    let snapshots = [Snapshot::default(), lost(), healthy(20), service, ids(), signals, axes()];
    for (snapshot, choice) in snapshots
        .iter()
        .flat_map(|snapshot| choices.into_iter().chain([help]).map(move |at| (snapshot, at)))
    {
        for (width, height) in [(0, 0), (1, 1), (54, 14), (55, 15), (80, 3), (3, 80), (400, 100)] {
            let lines = screen(width, height, snapshot, choice);
            assert_eq!(lines.lines().count(), usize::from(height));
        }
    }
}

#[test]
fn selected_gateway_of_many_is_visible() {
    shows!("many", (80, 24), healthy(20), Choice { gateway: 17, ..FIRST });
}

#[test]
fn help_is_over_the_rest() {
    shows!("help", (60, 14), healthy(1), Choice { has_help: true, is_paused: true, ..FIRST });
}

#[test]
fn screen_of_80_columns_has_received_frames() {
    shows!("standard", (80, 24), healthy(1), FIRST);
}

#[test]
fn service_screen_has_sampled_times_clients_and_losses() {
    shows!("service", (80, 24), through_service(), FIRST);
    shows!("service_wide", (120, 40), through_service(), FIRST);
}

#[test]
fn ids_screen_has_data_with_marked_changes() {
    let choice = Choice { view: View::Ids, ..FIRST };
    shows!("ids", (80, 24), ids(), choice);
    // The row of the CAN FD frame; it has 64 bytes.
    shows!("ids_fd", (80, 24), ids(), Choice { id: 4, filter: Channels::only(1), ..choice });
    shows!("ids_narrow", (54, 14), ids(), Choice { id: 20, ..choice });
    shows!("ids_wide", (120, 30), ids(), Choice { sort: Sort::Period, id: 30, ..choice });
    let mut terminal = Terminal::new(TestBackend::new(80, 24)).unwrap();
    terminal.draw(|frame| draw(frame, &ids(), choice, false)).unwrap();
    let buffer = terminal.backend().buffer();
    // The data of the first row; byte 1 changed, without colours too.
    let is_marked = |x| buffer[(x, 3)].modifier.contains(Modifier::UNDERLINED);
    let marked: Vec<_> = (56..79).map(is_marked).enumerate().filter(|marked| marked.1).collect();
    assert_eq!(marked, [(3, true), (4, true)]);
}

#[test]
fn ids_screen_has_signals_of_the_selected_frame() {
    let snapshot = with_signals(ids());
    let choice = Choice { view: View::Ids, id: 1, ..FIRST };
    shows!("signals", (80, 24), snapshot, choice);
    // Without room for all of them.
    shows!("signals_low", (54, 14), snapshot, choice);
}

#[test]
fn axes_screen_has_positions_and_the_selected_axis() {
    let choice = Choice { view: View::Axes, ..FIRST };
    shows!("axes", (80, 24), axes(), Choice { axis: 1, ..choice });
    shows!("axes_wide", (140, 24), axes(), choice);
    shows!("axes_none", (80, 14), healthy(1), choice);
}
