//! Units of positions, velocities and accelerations of an axis, and the line that shows them. Another thread
//! prints the messages and positions of a running axis: a terminal that blocks does not delay the cycle.

use std::f64::consts::TAU;
use std::fmt;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use ecan_cia402::Scale;
use ecan_tool_support::command_line::screen;
use ecan_tool_support::command_line::screen::{Sequence, Stream};

use crate::context::{Failure, Result};

// Not doc comments on the values: they would double the length of every help.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Unit {
    #[default]
    Deg,
    Rad,
    Turn,
    Step,
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Deg => "deg",
            Self::Rad => "rad",
            Self::Turn => "turn",
            Self::Step => "step",
        })
    }
}

impl Unit {
    /// Units per turn; `None` for steps.
    fn per_turn(self) -> Option<f64> {
        match self {
            Self::Deg => Some(360.0),
            Self::Rad => Some(TAU),
            Self::Turn => Some(1.0),
            Self::Step => None,
        }
    }
}

/// Conversion between the unit of the command line and steps of the position counter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisUnits {
    pub unit: Unit,
    steps_per_unit: f64,
    origin: f64,
}

impl AxisUnits {
    /// The units of an axis; `origin` is the step at position 0.
    pub fn new(unit: Unit, scale: Scale, origin: i32) -> Self {
        match unit.per_turn() {
            Some(per_turn) => {
                Self { unit, steps_per_unit: scale.steps() / per_turn, origin: origin.into() }
            }
            None => Self { unit, steps_per_unit: 1.0, origin: 0.0 },
        }
    }

    /// Steps at a position.
    pub fn steps(&self, position: f64) -> f64 {
        self.origin + position * self.steps_per_unit
    }

    /// Steps of a distance, velocity or acceleration, with its sign.
    pub fn length(&self, value: f64) -> f64 {
        value * self.steps_per_unit
    }

    /// Position at a step.
    pub fn position(&self, steps: f64) -> f64 {
        (steps - self.origin) / self.steps_per_unit
    }

    /// Distance, velocity or acceleration of steps, with its sign.
    pub fn value(&self, steps: f64) -> f64 {
        steps / self.steps_per_unit
    }

    fn decimals(&self) -> usize {
        match self.unit {
            Unit::Deg => 3,
            Unit::Rad | Unit::Turn => 5,
            Unit::Step => 0,
        }
    }

    /// Number without unit, in the precision of the unit.
    pub fn number(&self, value: f64) -> String {
        let decimals = self.decimals();
        let text = format!("{value:.decimals$}");
        match text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.')) {
            true => format!("{:.decimals$}", 0.0),
            false => text,
        }
    }

    /// Text of a position given in steps: `12.500 deg`.
    pub fn position_text(&self, steps: f64) -> String {
        format!("{} {}", self.number(self.position(steps)), self.unit)
    }

    /// Text of a distance given in steps.
    pub fn length_text(&self, steps: f64) -> String {
        format!("{} {}", self.number(self.value(steps)), self.unit)
    }

    /// Text of the amount of a velocity given in steps per second: `30.000 deg/s`.
    pub fn velocity_text(&self, steps_per_second: f64) -> String {
        format!("{} {}/s", self.number(self.value(steps_per_second).abs()), self.unit)
    }
}

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
        steps.map_or_else(|| "-".to_owned(), |steps| units.position_text(steps.into()))
    };
    let LivePosition { actual, target, following_error } = position;
    let following = following_error.map_or_else(
        || "-".to_owned(),
        |following_error| units.length_text(following_error as f64),
    );
    format!("position {}, target {}, following error {following}", text(*actual), text(*target))
}

#[cfg(test)]
mod tests {
    use ecan_cia402::Scale;

    use super::{Unit, *};

    #[test]
    fn positions_and_lengths_are_converted_with_origin_and_sign() {
        let scale = Scale::steps_per_turn(-3_600.0);
        let units = AxisUnits::new(Unit::Deg, scale, 100);
        assert_eq!((units.steps(10.0), units.length(10.0)), (0.0, -100.0));
        assert_eq!((units.position(0.0), units.value(-100.0)), (10.0, 10.0));
        assert_eq!(units.position_text(0.0), "10.000 deg");
        assert_eq!(units.velocity_text(-300.0), "30.000 deg/s");
        assert_eq!(units.number(-0.0001), "0.000", "no negative zero");
        let steps = AxisUnits::new(Unit::Step, scale, 100);
        assert_eq!((steps.steps(7.0), steps.position_text(7.0)), (7.0, "7 step".to_owned()));
        let turns = AxisUnits::new(Unit::Turn, scale, 0);
        assert_eq!(turns.steps(0.5), -1_800.0);
    }

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
