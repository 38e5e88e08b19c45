//! PSR: protocol status.

use std::fmt;

use serde::Serialize;

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

/// Protocol status of a channel (register PSR, 0x9000:02).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ProtocolStatus {
    /// Last error in the arbitration phase and in classic frames.
    pub last_error: LastErrorCode,
    /// Activity of the controller.
    pub activity: Activity,
    /// Error passive: a counter reached 128.
    pub is_error_passive: bool,
    /// Error warning: a counter reached 96.
    pub is_warning: bool,
    /// Bus-off.
    pub is_bus_off: bool,
    /// Last error in the data phase of CAN FD frames with bit rate switch.
    pub last_data_error: LastErrorCode,
    /// The last CAN FD frame received had its ESI bit set: its sender is error passive.
    pub has_received_esi: bool,
    /// The last CAN FD frame received had its bit rate switch.
    pub has_received_brs: bool,
    /// A CAN FD frame was received.
    pub has_received_fd: bool,
    /// A protocol exception happened.
    pub has_protocol_exception: bool,
    /// Transmitter delay, in MCAN clock periods (mtq), 0 to 127.
    pub transmitter_delay: u8,
}

impl ProtocolStatus {
    /// Decodes the register.
    pub const fn from_raw(raw: u32) -> Self {
        Self {
            last_error: LastErrorCode::from_raw(raw),
            activity: match raw >> 3 & 3 {
                0 => Activity::Synchronising,
                1 => Activity::Idle,
                2 => Activity::Receiving,
                _ => Activity::Sending,
            },
            is_error_passive: raw >> 5 & 1 == 1,
            is_warning: raw >> 6 & 1 == 1,
            is_bus_off: raw >> 7 & 1 == 1,
            last_data_error: LastErrorCode::from_raw(raw >> 8),
            has_received_esi: raw >> 11 & 1 == 1,
            has_received_brs: raw >> 12 & 1 == 1,
            has_received_fd: raw >> 13 & 1 == 1,
            has_protocol_exception: raw >> 14 & 1 == 1,
            transmitter_delay: (raw >> 16 & 0x7F) as u8,
        }
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
