//! Decoder of the MCAN registers in 0x9000..0x9003 and 0xA000..0xA003 (manual 13.5, 13.6).
//!
//! The manual names the registers; their bits are defined by the Bosch M_CAN core.

use std::fmt;

use ecan_protocol::object::WRITABLE_REGISTERS;
use serde::Serialize;

/// Declares a decoded register: its fields with their values in the raw register.
macro_rules! decoded_register {
    (
        $(#[$doc:meta])*
        pub struct $name:ident($raw:ident) {
            $($(#[$field_doc:meta])* $field:ident: $ty:ty = $value:expr,)*
        }
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: $ty,)*
        }

        impl $name {
            /// Decodes the register.
            pub const fn from_raw($raw: u32) -> Self {
                Self { $($field: $value,)* }
            }
        }
    };
}

/// Bits of a register from `shift` on, at most 8.
const fn field(raw: u32, shift: u32, mask: u32) -> u8 {
    (raw >> shift & mask & 0xFF) as u8
}

const fn bit(raw: u32, at: u32) -> bool {
    raw >> at & 1 == 1
}

/// Text of a register value; `None` if the register is not decoded.
pub fn text(offset: u16, value: u32) -> Option<String> {
    Some(match offset {
        0x0040 => ErrorCounters::from_raw(value).to_string(),
        0x0044 => ProtocolStatus::from_raw(value).to_string(),
        0x0050 => Interrupts(value).to_string(),
        0x0094 => HighPriorityStatus::from_raw(value).to_string(),
        0x00A4 | 0x00B4 => ReceiveFifoStatus::from_raw(value).to_string(),
        0x00C4 => TransmitQueueStatus::from_raw(value).to_string(),
        0x00F4 => EventFifoStatus::from_raw(value).to_string(),
        _ => return None,
    })
}

/// Register of the M_CAN core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// Offset in bytes.
    pub offset: u16,
    /// Name.
    pub name: &'static str,
    /// Description.
    pub description: &'static str,
}

impl Register {
    /// Returns whether the register service accepts writes (whitelist of manual 13.6).
    pub fn is_writable(&self) -> bool {
        WRITABLE_REGISTERS.iter().any(|(offset, _)| *offset == self.offset)
    }
}

const fn named(offset: u16, name: &'static str, description: &'static str) -> Register {
    Register { offset, name, description }
}

/// Named registers in the range of the service, 0x0004 to 0x0404.
pub const REGISTERS: [Register; 45] = [
    named(0x0004, "ENDN", "endianness"),
    named(0x000C, "DBTP", "data bit timing and prescaler"),
    named(0x0010, "TEST", "test"),
    named(0x0014, "RWD", "RAM watchdog"),
    named(0x0018, "CCCR", "control"),
    named(0x001C, "NBTP", "nominal bit timing and prescaler"),
    named(0x0020, "TSCC", "timestamp configuration"),
    named(0x0024, "TSCV", "timestamp value"),
    named(0x0028, "TOCC", "timeout configuration"),
    named(0x002C, "TOCV", "timeout value"),
    named(0x0040, "ECR", "error counters"),
    named(0x0044, "PSR", "protocol status"),
    named(0x0048, "TDCR", "transmitter delay compensation"),
    named(0x0050, "IR", "interrupt flags, write 1 to clear"),
    named(0x0054, "IE", "interrupt enable"),
    named(0x0058, "ILS", "interrupt line select"),
    named(0x005C, "ILE", "interrupt line enable"),
    named(0x0080, "GFC", "global filter configuration"),
    named(0x0084, "SIDFC", "standard filter list"),
    named(0x0088, "XIDFC", "extended filter list"),
    named(0x0090, "XIDAM", "extended identifier mask"),
    named(0x0094, "HPMS", "high priority message status"),
    named(0x0098, "NDAT1", "new data in receive buffers 0 to 31"),
    named(0x009C, "NDAT2", "new data in receive buffers 32 to 63"),
    named(0x00A0, "RXF0C", "RX FIFO0 configuration"),
    named(0x00A4, "RXF0S", "RX FIFO0 status"),
    named(0x00A8, "RXF0A", "RX FIFO0 acknowledge"),
    named(0x00AC, "RXBC", "receive buffer configuration"),
    named(0x00B0, "RXF1C", "RX FIFO1 configuration"),
    named(0x00B4, "RXF1S", "RX FIFO1 status"),
    named(0x00B8, "RXF1A", "RX FIFO1 acknowledge"),
    named(0x00BC, "RXESC", "receive element sizes"),
    named(0x00C0, "TXBC", "transmit buffer configuration"),
    named(0x00C4, "TXFQS", "transmit FIFO or queue status"),
    named(0x00C8, "TXESC", "transmit element size"),
    named(0x00CC, "TXBRP", "transmit requests pending"),
    named(0x00D0, "TXBAR", "transmit add request"),
    named(0x00D4, "TXBCR", "transmit cancellation request"),
    named(0x00D8, "TXBTO", "transmissions that occurred"),
    named(0x00DC, "TXBCF", "cancellations finished"),
    named(0x00E0, "TXBTIE", "transmission interrupt enable"),
    named(0x00E4, "TXBCIE", "cancellation interrupt enable"),
    named(0x00F0, "TXEFC", "transmit event FIFO configuration"),
    named(0x00F4, "TXEFS", "transmit event FIFO status"),
    named(0x00F8, "TXEFA", "transmit event FIFO acknowledge"),
];

/// Named register at an offset.
pub fn register(offset: u16) -> Option<Register> {
    REGISTERS.into_iter().find(|register| register.offset == offset)
}

/// Register by name, case-insensitive.
pub fn register_named(name: &str) -> Option<Register> {
    REGISTERS.into_iter().find(|register| register.name.eq_ignore_ascii_case(name))
}

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

decoded_register! {
    /// Receive FIFO (registers RXF0S and RXF1S, 0x9000:04 and :05).
    pub struct ReceiveFifoStatus(raw) {
        /// Pending frames, 0 to 64.
        fill: u8 = field(raw, 0, 0x7F),
        /// Get index.
        get_index: u8 = field(raw, 8, 0x3F),
        /// Put index.
        put_index: u8 = field(raw, 16, 0x3F),
        /// The FIFO is full.
        is_full: bool = bit(raw, 24),
        /// A frame was lost.
        has_lost: bool = bit(raw, 25),
    }
}

impl fmt::Display for ReceiveFifoStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} frames pending", self.fill)?;
        f.write_str(if self.is_full { ", full" } else { "" })?;
        f.write_str(if self.has_lost { ", frame lost" } else { "" })
    }
}

decoded_register! {
    /// Transmit FIFO or queue (register TXFQS, 0x9000:06).
    pub struct TransmitQueueStatus(raw) {
        /// Free elements, 0 to 32; 0 in queue mode.
        free: u8 = field(raw, 0, 0x3F),
        /// Get index.
        get_index: u8 = field(raw, 8, 0x1F),
        /// Put index.
        put_index: u8 = field(raw, 16, 0x1F),
        /// The FIFO is full.
        is_full: bool = bit(raw, 21),
    }
}

impl fmt::Display for TransmitQueueStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} elements free", self.free)?;
        f.write_str(if self.is_full { ", full" } else { "" })
    }
}

decoded_register! {
    /// Transmit event FIFO (register TXEFS, 0x9000:07).
    pub struct EventFifoStatus(raw) {
        /// Pending events, 0 to 32.
        fill: u8 = field(raw, 0, 0x3F),
        /// The FIFO is full.
        is_full: bool = bit(raw, 24),
        /// An event was lost.
        has_lost: bool = bit(raw, 25),
    }
}

impl fmt::Display for EventFifoStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} events pending", self.fill)?;
        f.write_str(if self.is_full { ", full" } else { "" })?;
        f.write_str(if self.has_lost { ", event lost" } else { "" })
    }
}

decoded_register! {
    /// Last high priority message (register HPMS, 0x9000:08).
    pub struct HighPriorityStatus(raw) {
        /// Index of the element.
        buffer: u8 = field(raw, 0, 0x3F),
        /// Storage: 0 none, 1 lost, 2 RX FIFO0, 3 RX FIFO1.
        storage: u8 = field(raw, 6, 3),
        /// Index of the matching filter.
        filter: u8 = field(raw, 8, 0x7F),
        /// The filter is an extended one.
        is_extended: bool = bit(raw, 15),
    }
}

impl fmt::Display for HighPriorityStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.is_extended { "extended" } else { "standard" };
        let location = match self.storage {
            0 => return f.write_str("none in a FIFO"),
            1 => "lost".to_owned(),
            fifo => format!("in RX FIFO{}, element {}", fifo - 2, self.buffer),
        };
        write!(f, "{location}, by {kind} filter {}", self.filter)
    }
}

/// Names of the bits of IR.
pub const INTERRUPTS: [(u8, &str); 30] = [
    (0, "new frame in RX FIFO0"),
    (1, "RX FIFO0 watermark"),
    (2, "RX FIFO0 full"),
    (3, "frame lost in RX FIFO0"),
    (4, "new frame in RX FIFO1"),
    (5, "RX FIFO1 watermark"),
    (6, "RX FIFO1 full"),
    (7, "frame lost in RX FIFO1"),
    (8, "high priority message"),
    (9, "transmission completed"),
    (10, "transmission cancelled"),
    (11, "transmit FIFO empty"),
    (12, "new transmit event"),
    (13, "transmit event watermark"),
    (14, "transmit event FIFO full"),
    (15, "transmit event lost"),
    (16, "timestamp wrapped"),
    (17, "Message RAM access failure"),
    (18, "timeout"),
    (19, "new frame in a receive buffer"),
    (20, "Message RAM bit error corrected"),
    (21, "Message RAM bit error not corrected"),
    (22, "error logging overflow"),
    (23, "error passive changed"),
    (24, "error warning changed"),
    (25, "bus-off changed"),
    (26, "RAM watchdog"),
    (27, "protocol error in the arbitration phase"),
    (28, "protocol error in the data phase"),
    (29, "access to a reserved address"),
];

/// Interrupt flags of a channel (register IR, 0x9000:03).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Interrupts(
    /// Raw register value.
    pub u32,
);

impl Interrupts {
    /// Returns whether RX FIFO0 and RX FIFO1 lost frames since the flags were cleared.
    pub const fn lost(self) -> (bool, bool) {
        (bit(self.0, 3), bit(self.0, 7))
    }

    /// Errors in the arbitration phase or in classic frames, and in the data phase, since the flags were
    /// cleared.
    pub const fn protocol_errors(self) -> (bool, bool) {
        (bit(self.0, 27), bit(self.0, 28))
    }

    /// Message RAM failure: late access, bit error, or watchdog.
    pub const fn has_ram_failure(self) -> bool {
        self.0 & (1 << 17 | 1 << 21 | 1 << 26) != 0
    }

    /// Names of the set flags.
    pub fn names(self) -> Vec<&'static str> {
        set_names(self.0, &INTERRUPTS)
    }
}

impl fmt::Display for Interrupts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.names()[..] {
            [] => f.write_str("none"),
            ref names => f.write_str(&names.join(", ")),
        }
    }
}

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

/// Names of the set bits, in the order of the table.
pub(crate) fn set_names(raw: u32, table: &[(u8, &'static str)]) -> Vec<&'static str> {
    let is_set = |bit: u8| raw.checked_shr(bit.into()).is_some_and(|shifted| shifted & 1 == 1);
    table.iter().filter(|(bit, _)| is_set(*bit)).map(|(_, word)| *word).collect()
}
