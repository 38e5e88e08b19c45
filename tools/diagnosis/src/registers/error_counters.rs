//! ECR: error counters.

use std::fmt;

use serde::Serialize;

/// Error counters of a channel (register ECR, 0x9000:01).
///
/// ISO 11898-1: error warning from 96, error passive from 128, bus-off if the transmit counter
/// exceeds 255.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ErrorCounters {
    /// Transmit error counter, 0 to 255.
    pub transmit: u8,
    /// Receive error counter, 0 to 127.
    pub receive: u8,
    /// The receive counter has reached the error passive level of 128.
    pub is_receive_passive: bool,
    /// Errors seen since the register was last read, 0 to 255, saturated.
    pub logged: u8,
}

impl ErrorCounters {
    /// Decodes the register.
    pub const fn from_raw(raw: u32) -> Self {
        let [transmit, receive, logged, _] = raw.to_le_bytes();
        Self { transmit, receive: receive & 0x7F, is_receive_passive: receive & 0x80 != 0, logged }
    }
}

impl fmt::Display for ErrorCounters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} transmit errors, ", self.transmit)?;
        match self.is_receive_passive {
            true => f.write_str("128 or more receive errors (passive)")?,
            false => write!(f, "{} receive errors", self.receive)?,
        }
        if self.logged != 0 {
            write!(f, ", {} logged", self.logged)?;
        }
        Ok(())
    }
}
