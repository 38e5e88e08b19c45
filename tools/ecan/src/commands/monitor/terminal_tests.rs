//! State of the terminal after a panic. The panicking program is this test program itself, on a
//! pseudo-terminal.

use std::path::{Path, PathBuf};
use std::process::Command;

use terminal::{ENTER, OnTerminal};

use super::super::observation::{Layout, LayoutGateway, Origin};
use super::*;

#[allow(dead_code)]
#[path = "../../../tests/cli/support/terminal.rs"]
mod terminal;
#[allow(dead_code)]
#[path = "../../../tests/cli/support/timed_reader.rs"]
mod timed_reader;

/// Path of the file that triggers the panic.
const SIGN: &str = "ECAN_TEST_PANIC_SIGN";
/// Panic message.
const WORDS: &str = "a panic for the test";
/// Exit status of a failed test program.
const FAILED: i32 = 101;

/// Returns whether this process was started on a terminal of its own.
fn is_on_its_terminal() -> bool {
    std::env::var_os(SIGN).is_some()
}

/// Returns whether the trigger file exists.
fn is_time() -> bool {
    std::env::var_os(SIGN).is_some_and(|path| Path::new(&path).exists())
}

/// Draws like the monitor until the trigger.
fn draw(frame: &mut Frame<'_>, snapshot: &Snapshot, choice: Choice, has_color: bool) {
    assert!(!is_time(), "{WORDS}");
    screen::draw(frame, snapshot, choice, has_color);
}

/// A drawing as in the monitor, and its queue.
fn drawing(draw: Draw, observations: usize) -> (Drawing, SyncSender<Observation>) {
    let (full, seen) = sync_channel(observations);
    let (spent, _) = sync_channel(observations);
    let (_, errors) = channel();
    let drawing = Drawing {
        collector: Collector::new(Origin::default(), WINDOW_NS),
        seen,
        spent,
        errors,
        is_over: Arc::new(AtomicBool::new(false)),
        has_color: false,
        choice: Choice::default(),
        signals: Arc::default(),
        draw,
    };
    (drawing, full)
}

/// Starts the thread of a drawing.
fn start(draw: Draw) -> (Joined, Arc<AtomicBool>) {
    let (drawing, full) = drawing(draw, OBSERVATIONS);
    let is_over = drawing.is_over.clone();
    let thread = std::thread::spawn(move || drawing.run());
    let joined = Joined { full: Some(full), thread: Some(thread) };
    let gateways = vec![LayoutGateway::default()];
    let layout = Some(Layout { gateways, ..Layout::default() });
    joined.hand_over(Observation { layout, ..Observation::new(1) });
    (joined, is_over)
}

#[test]
#[ignore = "started by the tests below on a terminal of its own"]
fn program_whose_drawing_panics() {
    if !is_on_its_terminal() {
        return;
    }
    let (mut joined, is_over) = start(draw);
    while !is_over.load(Ordering::Relaxed) {
        std::thread::yield_now();
    }
    // The panic continues here.
    let _ = joined.end();
}

#[test]
#[ignore = "started by the tests below on a terminal of its own"]
fn program_whose_cycle_panics() {
    if !is_on_its_terminal() {
        return;
    }
    let (_joined, is_over) = start(screen::draw);
    while !is_over.load(Ordering::Relaxed) {
        assert!(!is_time(), "{WORDS}");
        std::thread::yield_now();
    }
}

/// Runs a program until its screen is shown, triggers the panic, and waits for its end.
fn panics(program: &str) {
    let directory = tempfile::tempdir().unwrap();
    let sign: PathBuf = directory.path().join("sign");
    let name = format!("commands::monitor::terminal::tests::{program}");
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", &name, "--ignored", "--nocapture"]).env(SIGN, &sign);
    let mut monitor = OnTerminal::start(&mut command);
    monitor.wait_for(ENTER);
    monitor.wait_for("Channels");
    assert!(monitor.is_raw());
    std::fs::write(&sign, "").unwrap();
    let (status, said) = monitor.end();
    assert_eq!(status, Some(FAILED), "{said}");
    // After the screen, where it is readable.
    assert!(said.contains(WORDS), "{said}");
}

#[test]
fn source_that_is_faster_does_not_prevent_drawing() {
    let waiting = 10 * OBSERVATIONS;
    let (mut drawing, full) = drawing(screen::draw, waiting);
    for _ in 0..waiting {
        full.try_send(Observation::new(1)).unwrap();
    }
    assert!(drawing.take_waiting());
    assert!(drawing.seen.try_recv().is_ok());
    while drawing.seen.try_recv().is_ok() {}
    assert!(drawing.take_waiting(), "nothing waits, but the source runs");
    drop(full);
    assert!(!drawing.take_waiting());
}

#[test]
fn panic_while_drawing_restores_terminal() {
    panics("program_whose_drawing_panics");
}

#[test]
fn panic_in_cycle_restores_terminal() {
    panics("program_whose_cycle_panics");
}
