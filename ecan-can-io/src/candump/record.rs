//! A log line as a value.

use core::fmt;

use ecan_protocol::can::CanFrame;

use crate::candump::frame_text::FrameText;

/// Direction of a frame, as `candump -x` marks it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DirectionMark {
    /// `R`: received.
    Received,
    /// `T`: sent by the recording host.
    Transmitted,
}

/// One recorded frame.
///
/// `Display` writes the line: 6 decimals, or 9 if the time is not a whole number of microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record<'a> {
    /// Time in nanoseconds; candump counts from 1970 by default.
    pub time_ns: u64,
    /// Name of the CAN interface. Must be non-empty and without blanks for a line that
    /// [`parse_line`](crate::candump::parse_line) accepts.
    pub interface: &'a str,
    /// The frame.
    pub frame: CanFrame,
    /// Direction mark, if present.
    pub direction: Option<DirectionMark>,
}

impl fmt::Display for Record<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.time_ns / 1_000_000_000;
        let fraction = self.time_ns % 1_000_000_000;
        if fraction.is_multiple_of(1000) {
            write!(f, "({seconds:010}.{:06})", fraction / 1000)?;
        } else {
            write!(f, "({seconds:010}.{fraction:09})")?;
        }
        write!(f, " {} {}", self.interface, FrameText(&self.frame))?;
        match self.direction {
            None => Ok(()),
            Some(DirectionMark::Received) => f.write_str(" R"),
            Some(DirectionMark::Transmitted) => f.write_str(" T"),
        }
    }
}
