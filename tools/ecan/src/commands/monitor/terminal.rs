//! Full-screen mode: the source on the main thread, drawing and mailbox on other threads, and the detection of a
//! closed terminal.

use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, channel, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossterm::event;
use crossterm::event::Event;
use ecan_protocol::text::is_control;
use ecan_tool_support::command_line::interrupt::Interrupt;
use ratatui::Frame;
use ratatui::buffer::Buffer;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;

use super::collector::Collector;
use super::keys::{Action, Choice};
use super::observation::{GatewayErrors, LOOK_NS, Mailbox, Observation, Source};
use super::screen;
use super::snapshot::Snapshot;
use crate::context::{Failure, FullScreen, Output, Result};
use crate::frames::Signals;

/// Number of observations passed between the source and the drawing.
const OBSERVATIONS: usize = 3;
/// Window for the rates, in nanoseconds.
const WINDOW_NS: u64 = 1_000_000_000;
/// Maximum time of waiting for a key before the next drawing.
const FRAME: Duration = Duration::from_millis(100);
/// As short as possible: without any time, no key is found.
const NEXT_KEY: Duration = Duration::from_millis(1);
/// Time limit for the end of the drawing, which blocks if its terminal is blocked.
const END: Duration = Duration::from_secs(1);
const LOOK: Duration = Duration::from_millis(5);

pub fn run(
    source: &mut dyn Source,
    choice: Choice,
    signals: Arc<Signals>,
    interrupt: &Interrupt,
    output: &Output,
) -> Result {
    let (full, seen) = sync_channel(OBSERVATIONS);
    let (spent, empty) = sync_channel(OBSERVATIONS);
    for _ in 1..OBSERVATIONS {
        // All observations fit into the queue.
        let _ = spent.try_send(source.observation());
    }
    let (errors_out, errors_in) = channel();
    // Started before the real-time settings of the cycle thread, which it must not inherit.
    let mut _mailbox = Mailbox::start(source.error_reader()?, errors_out.clone())?;
    let hang_up = HangUp::watch().map_err(Failure::of_thread)?;
    let drawing = Drawing {
        collector: Collector::new(source.origin(), WINDOW_NS),
        seen,
        spent,
        errors: errors_in,
        is_over: Arc::new(AtomicBool::new(false)),
        has_color: output.has_color(),
        choice,
        signals,
        draw: screen::draw,
    };
    let is_over = drawing.is_over.clone();
    let thread = std::thread::Builder::new().name("drawing".to_owned());
    let thread = thread.spawn(move || drawing.run()).map_err(Failure::of_thread)?;
    let mut guard = Joined { full: Some(full), thread: Some(thread) };
    let mut observation = source.observation();
    source.enter_thread()?;
    let _full_screen = FullScreen::begin();
    source.start()?;
    // The first observation has the gateways of the frames that follow.
    let mut outcome = source.look(&mut observation);
    if let (Ok(()), Ok(next)) = (&outcome, empty.try_recv()) {
        guard.hand_over(std::mem::replace(&mut observation, next));
    }
    let mut look_ns = 0;
    let is_wanted = || !interrupt.is_set() && !hang_up.is_set() && !is_over.load(Ordering::Relaxed);
    while outcome.is_ok() && is_wanted() {
        outcome = source.observe(&mut observation);
        let now_ns = source.now_ns();
        if outcome.is_err() || (now_ns < look_ns && !observation.is_nearly_full()) {
            continue;
        }
        // If the drawing is late, the source continues with its own observation.
        if let Ok(next) = empty.try_recv() {
            look_ns = now_ns.saturating_add(LOOK_NS);
            outcome = source.look(&mut observation);
            if observation.layout.is_some()
                && let Ok(reader) = source.error_reader()
            {
                _mailbox = Mailbox::start(reader, errors_out.clone())?;
            }
            guard.hand_over(std::mem::replace(&mut observation, next));
        }
    }
    // The terminal is restored before anything else is printed.
    let drawn = guard.end();
    // The terminal is closed: errors of drawing are expected.
    if hang_up.is_set() { outcome } else { drawn.and(outcome) }
}

/// Thread of the drawing; ended when dropped.
struct Joined {
    full: Option<SyncSender<Observation>>,
    thread: Option<JoinHandle<Result>>,
}

impl Joined {
    fn hand_over(&self, observation: Observation) {
        if let Some(full) = &self.full {
            // All observations fit; without receiver the loop ends.
            let _ = full.try_send(observation);
        }
    }

    fn end(&mut self) -> Result {
        self.full = None;
        let Some(thread) = self.thread.take() else { return Ok(()) };
        let deadline = Instant::now() + END;
        while !thread.is_finished() {
            if Instant::now() >= deadline {
                // The thread is blocked by its terminal: restore it from here and exit.
                restore_in_time();
                return Ok(());
            }
            std::thread::sleep(LOOK);
        }
        match thread.join() {
            Ok(outcome) => outcome,
            Err(panic) if !std::thread::panicking() => std::panic::resume_unwind(panic),
            Err(_) => Ok(()),
        }
    }
}

impl Drop for Joined {
    fn drop(&mut self) {
        let _ = self.end();
    }
}

type Draw = fn(&mut Frame<'_>, &Snapshot, Choice, bool);

struct Drawing {
    collector: Collector,
    seen: Receiver<Observation>,
    spent: SyncSender<Observation>,
    /// By the position of the gateway.
    errors: Receiver<(usize, GatewayErrors)>,
    is_over: Arc<AtomicBool>,
    has_color: bool,
    choice: Choice,
    signals: Arc<Signals>,
    draw: Draw,
}

/// Reports the end of the drawing to the source.
struct Over(Arc<AtomicBool>);

impl Drop for Over {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Restores the terminal when dropped; the panic hook restores it before its message.
struct Restored;

impl Drop for Restored {
    fn drop(&mut self) {
        // A closed terminal needs no restoring.
        let _ = ratatui::try_restore();
    }
}

fn restore_in_time() {
    let (ending, ended) = channel::<()>();
    let restore = move || {
        drop(Restored);
        drop(ending);
    };
    if std::thread::Builder::new().name("restore".to_owned()).spawn(restore).is_ok() {
        let _ = ended.recv_timeout(END);
    }
}

/// Replaces characters of names from outside that the terminal would not show in their place.
fn replace_controls(buffer: &mut Buffer) {
    for cell in &mut buffer.content {
        if cell.symbol().contains(is_control) {
            cell.set_char(char::REPLACEMENT_CHARACTER);
        }
    }
}

impl Drawing {
    fn run(mut self) -> Result {
        let _over = Over(self.is_over.clone());
        // Messages before the cycle starts appear on the normal screen.
        let Ok(first) = self.seen.recv() else { return Ok(()) };
        self.take(first);
        let restored = Restored;
        let mut terminal = ratatui::try_init()?;
        let outcome = self.draw_all(&mut terminal);
        if terminal.show_cursor().is_err() {
            // The terminal is closed, and dropping this would print that on standard error.
            std::mem::forget(terminal);
        }
        drop(restored);
        outcome
    }

    fn take(&mut self, mut observation: Observation) {
        self.collector.take(&observation);
        observation.clear();
        let _ = self.spent.try_send(observation);
    }

    /// Takes what is waiting; returns `false` after the end of the source. Bounded, so that
    /// drawing and keys continue even if the source is faster.
    fn take_waiting(&mut self) -> bool {
        for _ in 0..OBSERVATIONS {
            match self.seen.try_recv() {
                Ok(observation) => self.take(observation),
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => return false,
            }
        }
        true
    }

    fn snapshot(&self) -> Snapshot {
        Snapshot { signals: self.signals.clone(), ..self.collector.snapshot() }
    }

    fn draw_all(&mut self, terminal: &mut ratatui::DefaultTerminal) -> Result {
        let mut choice = self.choice;
        let mut shown = self.snapshot();
        loop {
            if !self.take_waiting() {
                return Ok(());
            }
            while let Ok((position, errors)) = self.errors.try_recv() {
                self.collector.take_errors(position, errors);
            }
            if !choice.is_paused {
                shown = self.snapshot();
            }
            terminal.draw(|frame| {
                (self.draw)(frame, &shown, choice, self.has_color);
                replace_controls(frame.buffer_mut());
            })?;
            let mut is_waiting = event::poll(FRAME)?;
            while is_waiting {
                if let Event::Key(key) = event::read()? {
                    match choice.press(key, &shown) {
                        Action::Quit => return Ok(()),
                        Action::Clear => self.collector.clear(),
                        Action::None => {}
                    }
                }
                is_waiting = event::poll(NEXT_KEY)?;
            }
        }
    }
}

/// Set when the terminal is closed. A program may not get SIGHUP then, and reading from such a
/// terminal does not block.
#[derive(Clone, Debug, Default)]
pub struct HangUp(Arc<AtomicBool>);

impl HangUp {
    /// Watches standard output, and standard input if it is a terminal, on a detached thread.
    pub fn watch() -> std::io::Result<Self> {
        let hang_up = Self::default();
        let flag = hang_up.0.clone();
        std::thread::Builder::new().name("hang-up".to_owned()).spawn(move || {
            wait_for_hang_up();
            flag.store(true, Ordering::Relaxed);
        })?;
        Ok(hang_up)
    }

    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Returns when one of the terminals is closed or cannot be polled.
#[allow(clippy::disallowed_methods)] // Nothing is printed.
fn wait_for_hang_up() {
    let (input, output) = (std::io::stdin(), std::io::stdout());
    // A hang-up is always reported; no other events are requested.
    let mut ends = vec![PollFd::new(&output, PollFlags::empty())];
    if input.is_terminal() {
        ends.push(PollFd::new(&input, PollFlags::empty()));
    }
    while poll(&mut ends, None) == Err(Errno::INTR) {}
}

#[cfg(test)]
#[path = "terminal_tests.rs"]
mod tests;
