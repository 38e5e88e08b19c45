//! Tests of the screens as text.

use ratatui::Terminal;
use ratatui::backend::TestBackend;

use super::super::snapshot::{CycleView, Errors, Event, Times};
use super::*;

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

fn channel(load: f64) -> ChannelView {
    ChannelView {
        state: Some("run".to_owned()),
        rx_per_second: load * 4500.0,
        received: 120_400,
        load,
        errors: Some(Errors::default()),
        ..ChannelView::default()
    }
}

fn gateway(position: usize) -> GatewayView {
    GatewayView {
        position,
        state: GatewayState::Ready,
        working_counter: 3,
        expected_working_counter: 3,
        times_in_service: 1,
        channels: [channel(0.402), channel(0.1), channel(0.0), channel(0.0)],
        ..GatewayView::default()
    }
}

fn healthy(gateways: usize) -> Snapshot {
    Snapshot {
        seconds: 61.7,
        is_simulated: true,
        cycle: CycleView {
            cycle_us: 1000.0,
            cycles: 61_700,
            overruns: 1,
            skipped: 2,
            period: Times {
                min_us: 948.2,
                p50_us: 1000.0,
                p95_us: 1004.3,
                p99_us: 1010.1,
                p99_9_us: 1044.4,
                max_us: 2013.9,
            },
            run_time: Times { min_us: 11.0, max_us: 87.5, ..Times::default() },
            histogram: [0, 31, 5_000, 50_000, 6_000, 668, 1],
            ..CycleView::default()
        },
        gateways: (0..gateways).map(gateway).collect(),
        events: vec![Event { seconds: 0.9, words: "gateway 0: ready".to_owned() }],
    }
}

fn bus_off() -> Snapshot {
    let mut snapshot = healthy(1);
    snapshot.gateways[0].channels[1] = ChannelView {
        state: Some("bus-off".to_owned()),
        is_bus_off: true,
        has_warning: true,
        tx_pending: 7,
        errors: Some(Errors { transmit: 255, receive: 3, dropped: 12, bus_offs: 2 }),
        ..ChannelView::default()
    };
    snapshot
}

fn lost() -> Snapshot {
    let mut snapshot = healthy(2);
    let channels = std::array::from_fn(|_| ChannelView::default());
    snapshot.gateways[1] = GatewayView {
        state: GatewayState::Lost,
        reason: "waiting for OP".to_owned(),
        working_counter: 0,
        incomplete_cycles: 812,
        times_lost: 1,
        channels,
        ..gateway(1)
    };
    snapshot.events.push(Event { seconds: 60.9, words: "gateway 1: lost".to_owned() });
    snapshot
}

/// Compares a screen with its file.
macro_rules! shows {
    ($name:literal, $size:expr, $snapshot:expr, $choice:expr) => {
        let (width, height) = $size;
        let shown = screen(width, height, &$snapshot, $choice);
        let expected = include_str!(concat!("screens/", $name, ".txt"));
        assert_eq!(shown, expected, "{}:\n{shown}", $name);
    };
}

const FIRST: Choice = Choice { gateway: 0, channel: 0, is_paused: false, has_help: false };

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
    let real = Snapshot { is_simulated: false, ..bus_off() };
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
}

#[test]
fn any_size_can_be_drawn() {
    let help = Choice { has_help: true, gateway: 19, channel: 3, is_paused: true };
    for snapshot in [Snapshot::default(), lost(), healthy(20)] {
        for (width, height) in [(0, 0), (1, 1), (54, 14), (55, 15), (80, 3), (3, 80), (400, 100)] {
            let lines = screen(width, height, &snapshot, help);
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
