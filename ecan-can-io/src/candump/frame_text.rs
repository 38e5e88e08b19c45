//! Text of a frame in logs and for `cansend`.

use core::fmt;

use ecan_protocol::can::{CanFrame, FrameKind};

/// Formats a frame as in candump logs and for `cansend`, for example `123#DEADBEEF`.
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
