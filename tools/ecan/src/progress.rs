//! Line on the terminal during long reading or writing of gateways.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use ecan_tool_support::command_line::screen::{self, Sequence, Stream};

/// Time after which the line appears.
const PATIENCE: Duration = Duration::from_secs(2);
const REDRAW: Duration = Duration::from_millis(200);

/// The terminal is one for all threads.
static LINE: Mutex<Option<Line>> = Mutex::new(None);

struct Line {
    subject: String,
    started: Instant,
    drawn: Option<Instant>,
    transfers: u32,
}

/// Shows the progress of SDO transfers until it is dropped; nothing unless standard error is a
/// terminal.
pub struct Progress(());

impl Progress {
    /// `subject`: what is done, for example "reading slave 0".
    pub fn show(subject: impl Into<String>) -> Self {
        if Stream::Error.is_terminal() {
            let line = Line {
                subject: subject.into(),
                started: Instant::now(),
                drawn: None,
                transfers: 0,
            };
            *lock() = Some(line);
        }
        Self(())
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        clear();
        *lock() = None;
    }
}

/// Counts an SDO transfer.
pub fn step() {
    let mut line = lock();
    let Some(line) = &mut *line else { return };
    line.transfers += 1;
    if line.started.elapsed() < PATIENCE || line.drawn.is_some_and(|drawn| drawn.elapsed() < REDRAW)
    {
        return;
    }
    line.drawn = Some(Instant::now());
    let Line { subject, transfers, started, .. } = line;
    let seconds = started.elapsed().as_secs();
    screen::print(
        Stream::Error,
        format_args!("{}{subject}: {transfers} transfers, {seconds} s", Sequence::ClearLine),
    );
}

/// Removes the line before other output; the next transfer shows it again.
pub fn clear() {
    if let Some(line) = &mut *lock()
        && line.drawn.take().is_some()
    {
        screen::print(Stream::Error, Sequence::ClearLine);
    }
}

fn lock() -> std::sync::MutexGuard<'static, Option<Line>> {
    LINE.lock().unwrap_or_else(PoisonError::into_inner)
}
