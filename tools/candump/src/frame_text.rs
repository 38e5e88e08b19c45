//! A frame alone, as logs and `cansend` have it.

use core::fmt;

use ecan_protocol::can::{CanFrame, FrameKind};

use crate::cursor::Cursor;
use crate::error::{ParseError, ParseErrorKind};
use crate::parse::frame;

/// Reads a frame, `123#DEADBEEF` or the like: what stands behind the interface in a log.
///
/// # Errors
/// The first thing that the [grammar](crate) of `frame` does not allow, with its column.
pub fn parse_frame(text: &str) -> Result<CanFrame, ParseError> {
    let mut cursor = Cursor::new(text);
    let frame = frame(&mut cursor)?;
    if cursor.at_end() { Ok(frame) } else { Err(cursor.error(ParseErrorKind::Trailing)) }
}

/// Writes a frame as logs and `cansend` have it.
#[derive(Clone, Copy, Debug)]
pub struct FrameText<'a>(pub &'a CanFrame);

impl fmt::Display for FrameText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(frame) = self;
        let id = frame.id();
        if id.is_extended() {
            write!(f, "{:08X}#", id.raw())?;
        } else {
            write!(f, "{:03X}#", id.raw())?;
        }
        match frame.kind() {
            FrameKind::Data => {}
            FrameKind::Remote => {
                f.write_str("R")?;
                let dlc = frame.dlc().value();
                if dlc > 0 {
                    write!(f, "{dlc}")?;
                }
            }
            FrameKind::Fd { brs, esi } => {
                write!(f, "#{}", u8::from(brs) | u8::from(esi) << 1)?;
            }
        }
        for byte in frame.data() {
            write!(f, "{byte:02X}")?;
        }
        Ok(())
    }
}
