//! One line of a log as a value.

use core::fmt;

use ecan_protocol::can::CanFrame;

use crate::frame_text::FrameText;

/// Which way a frame went, as `candump -x` marks it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DirectionMark {
    /// `R`: received.
    Received,
    /// `T`: sent by the recording host itself.
    Transmitted,
}

/// One recorded frame.
///
/// `Display` writes the line back: microseconds, or nanoseconds where the time is not a whole
/// number of microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record<'a> {
    /// Time of the recording in nanoseconds; with candump since 1970 unless asked otherwise.
    pub time_ns: u64,
    /// Name of the CAN interface. For `Display` to give a line that can be read again it must
    /// not be empty nor contain blanks.
    pub interface: &'a str,
    /// The frame.
    pub frame: CanFrame,
    /// The direction mark, if the line has one.
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
