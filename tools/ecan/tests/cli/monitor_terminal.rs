//! `ecan monitor` on a terminal that does what terminals do.

use crate::support::on_screen::OnScreen;
use crate::support::{scenario, setting};
use rustix::process::Signal;

const MONITOR: [&str; 3] = ["--ecrt", "sim", "monitor"];
/// What stands below everything.
const KEYS: &str = "q end  ? help  2 CAN IDs  3 axes  p pause  c clear  arrows select";

#[test]
fn monitor_ends_with_its_terminal() {
    // Whether the signal comes depends on how it was started.
    for start in [OnScreen::start, OnScreen::start_leader] {
        let mut monitor = start((100, 40), &MONITOR);
        monitor.wait_for("ready      2/2");
        monitor.close();
        let errors = monitor.ends(0);
        assert!(errors.starts_with("SIMULATED") && errors.lines().count() == 1, "{errors}");
    }
}

#[test]
fn signal_ends_monitor_with_blocked_terminal() {
    let mut monitor = OnScreen::start((100, 40), &MONITOR);
    monitor.wait_for("ready      2/2");
    monitor.fill();
    monitor.signal(Signal::TERM);
    monitor.ends(0);
    assert!(!monitor.is_raw());
}

#[test]
fn every_terminal_size_is_drawn() {
    let bus = scenario("[[gateway]]\n[[gateway]]\n");
    let mut monitor = OnScreen::start((20, 5), &["--ecrt", &setting(&bus), "monitor"]);
    let tiny = |screen: String| {
        let states: Vec<_> = screen.lines().take(2).map(str::trim_end).collect();
        states == ["0 ready", "1 ready"] && screen.ends_with("\nSIMULATED  q end  ?")
    };
    monitor.wait_until("tiny screen", |terminal| tiny(terminal.screen()));
    for (columns, rows) in [(80, 24), (120, 40), (54, 14), (200, 60)] {
        monitor.resize((columns, rows));
        monitor.wait_until("screen of its size", |terminal| {
            let screen = terminal.screen();
            let lines: Vec<_> = screen.lines().collect();
            lines.len() == usize::from(rows)
                && lines[1].chars().count() == usize::from(columns)
                && screen.contains("Channels of gateway 0")
                && screen.ends_with(&KEYS[..KEYS.len().min(columns.into())])
        });
    }
    monitor.resize((20, 12));
    monitor.wait_until("tiny screen", |terminal| tiny(terminal.screen()));
    monitor.press(b"q");
    monitor.wait_until("shell", |terminal| !terminal.has_own_screen());
    monitor.ends(0);
}

#[test]
fn key_help_opens_and_closes() {
    let mut monitor = OnScreen::start((80, 24), &MONITOR);
    monitor.wait_for(KEYS);
    assert!(monitor.has_own_screen() && monitor.is_raw());
    for close in [b"?", b"\x1b"] {
        monitor.press(b"?");
        monitor.wait_for("close this help");
        monitor.press(close);
        monitor
            .wait_until("screen without help", |terminal| !terminal.screen().contains("this help"));
        assert!(monitor.screen().contains("Channels of gateway 0"));
    }
    monitor.press(b"q");
    monitor.wait_until("shell", |terminal| !terminal.has_own_screen());
    monitor.ends(0);
    assert!(!monitor.is_raw());
}

#[test]
fn fast_keys_are_not_lost() {
    let bus = scenario("[[gateway]]\n[[gateway]]\n");
    let mut monitor = OnScreen::start((80, 24), &["--ecrt", &setting(&bus), "monitor"]);
    monitor.wait_for("can0: ");
    // No part of a key is taken for Esc, which would end it.
    monitor.press(&[&b"\x1b[C".repeat(300)[..], b"\x1b[B", b"p"].concat());
    monitor.wait_for("PAUSED");
    monitor.wait_for("can3: ");
    monitor.wait_for("Channels of gateway 1");
    monitor.press(&[&b"?".repeat(301)[..], &b"\x1b[D".repeat(200)].concat());
    monitor.wait_for("close this help");
    monitor.press(b"?p");
    monitor.wait_for("can0: ");
    monitor.quit();
}

#[test]
fn key_during_a_change_of_size_is_not_lost() {
    let mut monitor = OnScreen::start((100, 40), &MONITOR);
    monitor.wait_for(KEYS);
    for columns in (90..110).rev() {
        monitor.resize((columns, 40));
        monitor.press(b"p");
        monitor.wait_for("PAUSED");
        monitor.press(b"p");
        monitor.wait_until("continued view", |terminal| !terminal.screen().contains("PAUSED"));
    }
    monitor.quit();
}
