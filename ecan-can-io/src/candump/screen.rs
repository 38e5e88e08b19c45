//! Text of a frame in the columns of candump.

use core::fmt;

use ecan_protocol::can::{CanFrame, FrameKind};

/// Longest frame whose ASCII characters are shown, in bytes.
const ASCII_BYTES: usize = 8;

/// Formats a frame in candump's columns: CAN ID, length in brackets, bytes.
///
/// ```
/// use ecan_can_io::candump::{ScreenFrame, parse_frame};
///
/// let frame = parse_frame("123#DEADBEEF")?;
/// assert_eq!(ScreenFrame::new(&frame).to_string(), "123   [4]  DE AD BE EF");
/// # Ok::<(), ecan_can_io::candump::ParseError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ScreenFrame<'a> {
    /// The frame.
    pub frame: &'a CanFrame,
    /// Align standard CAN IDs with the last digits of extended ones, as candump does after the first
    /// extended frame.
    pub is_indented: bool,
    /// Append the ASCII characters of frames of at most 8 bytes (`candump -a`).
    pub has_ascii: bool,
}

impl<'a> ScreenFrame<'a> {
    /// Formats without indentation and ASCII characters.
    #[must_use]
    pub const fn new(frame: &'a CanFrame) -> Self {
        Self { frame, is_indented: false, has_ascii: false }
    }
}

impl fmt::Display for ScreenFrame<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frame, is_indented, has_ascii } = *self;
        let id = frame.id();
        match (id.is_extended(), is_indented) {
            (true, _) => write!(f, "{:08X}  ", id.raw())?,
            (false, true) => write!(f, "     {:03X}  ", id.raw())?,
            (false, false) => write!(f, "{:03X}  ", id.raw())?,
        }
        let data = frame.data();
        match frame.kind() {
            FrameKind::Fd { .. } => write!(f, "[{:02}] ", data.len())?,
            FrameKind::Data => write!(f, " [{}] ", data.len())?,
            FrameKind::Remote => {
                return write!(f, " [{}]  remote request", frame.dlc().value());
            }
        }
        for byte in data {
            write!(f, " {byte:02X}")?;
        }
        if has_ascii && data.len() <= ASCII_BYTES {
            write!(f, "{:>1$}", "'", 3 * (ASCII_BYTES - data.len()) + 4)?;
            for byte in data {
                let is_visible = (0x20..0x7F).contains(byte);
                write!(f, "{}", if is_visible { char::from(*byte) } else { '.' })?;
            }
            f.write_str("'")?;
        }
        Ok(())
    }
}
