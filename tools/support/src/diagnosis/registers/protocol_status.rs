//! PSR: protocol status.

use std::fmt;

use serde::Serialize;

use super::{bit, field};

/// Activity of the controller on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Activity {
    /// Synchronising to the bus.
    Synchronising,
    /// Idle.
    Idle,
    /// Receiving.
    Receiving,
    /// Sending.
    Sending,
}

impl Activity {
    const fn from_raw(raw: u32) -> Self {
        match raw & 3 {
            0 => Self::Synchronising,
            1 => Self::Idle,
            2 => Self::Receiving,
            _ => Self::Sending,
        }
    }
}

/// Last error code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LastErrorCode {
    /// The last frame was without error.
    None,
    /// More than five equal bits in a row.
    Stuff,
    /// A fixed part of a frame had the wrong form.
    Form,
    /// No acknowledgement.
    Acknowledge,
    /// A recessive bit was sent, a dominant one was read.
    Bit1,
    /// A dominant bit was sent, a recessive one was read.
    Bit0,
    /// The CRC did not match.
    Crc,
    /// No event since the last read of the register.
    NoChange,
}

impl LastErrorCode {
    /// Decodes three bits.
    pub const fn from_raw(raw: u32) -> Self {
        match raw & 7 {
            0 => Self::None,
            1 => Self::Stuff,
            2 => Self::Form,
            3 => Self::Acknowledge,
            4 => Self::Bit1,
            5 => Self::Bit0,
            6 => Self::Crc,
            _ => Self::NoChange,
        }
    }

    /// Returns whether it is an error.
    pub const fn is_error(self) -> bool {
        !matches!(self, Self::None | Self::NoChange)
    }
}

impl fmt::Display for LastErrorCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "no error",
            Self::Stuff => "stuff error",
            Self::Form => "form error",
            Self::Acknowledge => "acknowledge error",
            Self::Bit1 => "bit 1 error",
            Self::Bit0 => "bit 0 error",
            Self::Crc => "CRC error",
            Self::NoChange => "no change",
        })
    }
}

decoded_register! {
    /// Protocol status of a channel (register PSR, 0x9000:02).
    pub struct ProtocolStatus(raw) {
        /// Last error in the arbitration phase and in classic frames.
        last_error: LastErrorCode = LastErrorCode::from_raw(raw),
        /// Activity of the controller.
        activity: Activity = Activity::from_raw(raw >> 3),
        /// Error passive: a counter reached 128.
        is_error_passive: bool = bit(raw, 5),
        /// Error warning: a counter reached 96.
        is_warning: bool = bit(raw, 6),
        /// Bus-off.
        is_bus_off: bool = bit(raw, 7),
        /// Last error in the data phase of CAN FD frames with bit rate switch.
        last_data_error: LastErrorCode = LastErrorCode::from_raw(raw >> 8),
        /// The last CAN FD frame received had its ESI bit set: its sender is error passive.
        has_received_esi: bool = bit(raw, 11),
        /// The last CAN FD frame received had its bit rate switch.
        has_received_brs: bool = bit(raw, 12),
        /// A CAN FD frame was received.
        has_received_fd: bool = bit(raw, 13),
        /// A protocol exception happened.
        has_protocol_exception: bool = bit(raw, 14),
        /// Transmitter delay, in MCAN clock periods (mtq), 0 to 127.
        transmitter_delay: u8 = field(raw, 16, 0x7F),
    }
}

impl fmt::Display for ProtocolStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.activity {
            Activity::Synchronising => "synchronising",
            Activity::Idle => "idle",
            Activity::Receiving => "receiving",
            Activity::Sending => "sending",
        })?;
        let state = match self {
            Self { is_bus_off: true, .. } => ", bus-off",
            Self { is_error_passive: true, .. } => ", error passive",
            Self { is_warning: true, .. } => ", error warning",
            _ => ", error active",
        };
        f.write_str(state)?;
        write!(f, ", last error: {}", self.last_error)?;
        if self.last_data_error.is_error() {
            write!(f, ", in the data phase: {}", self.last_data_error)?;
        }
        for (is_set, word) in [
            (self.has_received_fd, "CAN FD frame received"),
            (self.has_received_brs, "with bit rate switch"),
            (self.has_received_esi, "from an error passive sender"),
            (self.has_protocol_exception, "protocol exception"),
        ] {
            if is_set {
                write!(f, ", {word}")?;
            }
        }
        if self.transmitter_delay != 0 {
            write!(f, ", transmitter delay {} mtq", self.transmitter_delay)?;
        }
        Ok(())
    }
}
