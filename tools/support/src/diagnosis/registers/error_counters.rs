//! ECR: error counters.

use std::fmt;

use super::{bit, field};

decoded_register! {
    /// Error counters of a channel (register ECR, 0x9000:01).
    ///
    /// ISO 11898-1: error warning from 96, error passive from 128, bus-off if the transmit counter
    /// exceeds 255.
    pub struct ErrorCounters(raw) {
        /// Transmit error counter, 0 to 255.
        transmit: u8 = field(raw, 0, 0xFF),
        /// Receive error counter, 0 to 127.
        receive: u8 = field(raw, 8, 0x7F),
        /// The receive counter has reached the error passive level of 128.
        is_receive_passive: bool = bit(raw, 15),
        /// Errors seen since the register was last read, 0 to 255, saturated.
        logged: u8 = field(raw, 16, 0xFF),
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
