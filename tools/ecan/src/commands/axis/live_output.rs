//! Messages and positions of a running axis, printed by another thread: a terminal that blocks does not
//! delay the cycle.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ecan_tool_support::command_line::screen::{self, Sequence, Stream};

use crate::context::{Failure, Result};

use super::unit::AxisUnits;

/// Interval of the positions, in ns.
const REDRAW_NS: u64 = 100_000_000;
/// Messages that can wait; further ones are lost.
const WAITING: usize = 64;
/// Longest time to wait for a blocked terminal at the end.
const END: Duration = Duration::from_secs(1);
const LOOK: Duration = Duration::from_millis(2);

/// Positions in steps.
#[derive(Clone, Copy, Debug, Default)]
pub struct LivePosition {
    pub actual: Option<i32>,
    pub target: Option<i32>,
    pub following_error: Option<i64>,
}

enum Message {
    Text(String),
    Position(LivePosition),
}

/// Output on standard error; positions only on a terminal.
#[derive(Debug)]
pub struct LiveOutput {
    sender: Option<SyncSender<Message>>,
    thread: Option<JoinHandle<()>>,
    shows_positions: bool,
    drawn_ns: Option<u64>,
}

impl LiveOutput {
    /// Starts the thread, before real-time settings, which it must not inherit. `is_silent` prints nothing.
    pub fn start(units: AxisUnits, is_silent: bool) -> Result<Self> {
        let (sender, receiver) = sync_channel(WAITING);
        let thread = std::thread::Builder::new().name("output".to_owned());
        let thread =
            thread.spawn(move || print_all(&receiver, units)).map_err(Failure::of_thread)?;
        Ok(Self {
            sender: (!is_silent).then_some(sender),
            thread: Some(thread),
            shows_positions: Stream::Error.is_terminal(),
            drawn_ns: None,
        })
    }

    /// Prints a line.
    pub fn text(&self, text: String) {
        if let Some(sender) = &self.sender {
            let _ = sender.try_send(Message::Text(text));
        }
    }

    /// Replaces the line of positions, at most every 100 ms. Does not allocate.
    pub fn position(&mut self, now_ns: u64, position: LivePosition) {
        let is_due = self.drawn_ns.is_none_or(|at| now_ns.saturating_sub(at) >= REDRAW_NS);
        if let (Some(sender), true, true) = (&self.sender, self.shows_positions, is_due) {
            self.drawn_ns = Some(now_ns);
            let _ = sender.try_send(Message::Position(position));
        }
    }

    /// Prints what waits, unless the terminal is blocked.
    pub fn finish(&mut self) {
        self.sender = None;
        let Some(thread) = self.thread.take() else { return };
        let deadline = Instant::now() + END;
        while !thread.is_finished() && Instant::now() < deadline {
            std::thread::sleep(LOOK);
        }
    }
}

impl Drop for LiveOutput {
    fn drop(&mut self) {
        self.finish();
    }
}

fn print_all(receiver: &Receiver<Message>, units: AxisUnits) {
    let mut has_line = false;
    // A terminal that is closed gets nothing.
    let write = |text: std::fmt::Arguments<'_>| screen::print(Stream::Error, text);
    for message in receiver {
        if std::mem::take(&mut has_line) {
            write(format_args!("{}", Sequence::ClearLine));
        }
        match message {
            Message::Text(text) => write(format_args!("{text}\n")),
            Message::Position(position) => {
                has_line = true;
                write(format_args!("{}", line(&position, &units)));
            }
        }
    }
    if has_line {
        write(format_args!("{}", Sequence::ClearLine));
    }
}

fn line(position: &LivePosition, units: &AxisUnits) -> String {
    let text = |steps: Option<i32>| {
        steps.map_or_else(|| "-".to_owned(), |it| units.position_text(it.into()))
    };
    let LivePosition { actual, target, following_error } = position;
    let following =
        following_error.map_or_else(|| "-".to_owned(), |it| units.length_text(it as f64));
    format!("position {}, target {}, following error {following}", text(*actual), text(*target))
}

#[cfg(test)]
mod tests {
    use super::super::unit::Unit;
    use super::*;
    use ecan_cia402::Scale;

    #[test]
    fn line_shows_what_is_known() {
        let units = AxisUnits::new(Unit::Deg, Scale::steps_per_turn(3_600.0), 0);
        let none = line(&LivePosition::default(), &units);
        assert_eq!(none, "position -, target -, following error -");
        let position =
            LivePosition { actual: Some(95), target: Some(100), following_error: Some(5) };
        let text = line(&position, &units);
        assert_eq!(text, "position 9.500 deg, target 10.000 deg, following error 0.500 deg");
    }
}
