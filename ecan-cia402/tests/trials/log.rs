//! Readable log of a trial.

use std::fmt::Write as _;

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    Off,
    Events,
    /// Also every target and every controller period.
    Motion,
}

#[derive(Debug)]
pub struct Log {
    level: Level,
    pub text: String,
}

impl Log {
    pub fn new(level: Level) -> Self {
        Self { level, text: String::new() }
    }

    pub fn is_on(&self) -> bool {
        self.level > Level::Off
    }

    pub fn line(&mut self, now_ns: u64, text: &str) {
        if self.is_on() {
            // infallible: writing to a string
            let _ = writeln!(self.text, "{:>10.3}  {text}", now_ns as f64 / 1e6);
        }
    }

    pub fn drive(&mut self, axis: usize) -> DriveLog<'_> {
        DriveLog { log: self, axis }
    }
}

/// The log of one drive.
pub struct DriveLog<'a> {
    log: &'a mut Log,
    axis: usize,
}

impl DriveLog<'_> {
    pub fn line(&mut self, at_ns: u64, text: impl FnOnce() -> String) {
        if self.log.is_on() {
            let text = format!("  drive {}: {}", self.axis, text());
            self.log.line(at_ns, &text);
        }
    }

    pub fn detail(&mut self, at_ns: u64, text: impl FnOnce() -> String) {
        if self.log.level == Level::Motion {
            self.line(at_ns, text);
        }
    }
}
