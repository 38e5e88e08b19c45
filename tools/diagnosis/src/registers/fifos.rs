//! RXF0S, RXF1S, TXFQS, TXEFS and HPMS: fill levels of the Message RAM.

use std::fmt;

use serde::Serialize;

const fn field(raw: u32, shift: u32, mask: u32) -> u8 {
    (raw >> shift & mask & 0xFF) as u8
}

const fn bit(raw: u32, at: u32) -> bool {
    raw >> at & 1 == 1
}

/// Receive FIFO (registers RXF0S and RXF1S, 0x9000:04 and :05).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ReceiveFifoStatus {
    /// Pending frames, 0 to 64.
    pub fill: u8,
    /// Get index.
    pub get_index: u8,
    /// Put index.
    pub put_index: u8,
    /// The FIFO is full.
    pub is_full: bool,
    /// A frame was lost.
    pub has_lost: bool,
}

impl ReceiveFifoStatus {
    /// Decodes the register.
    pub const fn from_raw(raw: u32) -> Self {
        Self {
            fill: field(raw, 0, 0x7F),
            get_index: field(raw, 8, 0x3F),
            put_index: field(raw, 16, 0x3F),
            is_full: bit(raw, 24),
            has_lost: bit(raw, 25),
        }
    }
}

impl fmt::Display for ReceiveFifoStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} frames pending", self.fill)?;
        f.write_str(if self.is_full { ", full" } else { "" })?;
        f.write_str(if self.has_lost { ", frame lost" } else { "" })
    }
}

/// Transmit FIFO or queue (register TXFQS, 0x9000:06).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct TransmitQueueStatus {
    /// Free elements, 0 to 32; 0 in queue mode.
    pub free: u8,
    /// Get index.
    pub get_index: u8,
    /// Put index.
    pub put_index: u8,
    /// The FIFO is full.
    pub is_full: bool,
}

impl TransmitQueueStatus {
    /// Decodes the register.
    pub const fn from_raw(raw: u32) -> Self {
        Self {
            free: field(raw, 0, 0x3F),
            get_index: field(raw, 8, 0x1F),
            put_index: field(raw, 16, 0x1F),
            is_full: bit(raw, 21),
        }
    }
}

impl fmt::Display for TransmitQueueStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} elements free", self.free)?;
        f.write_str(if self.is_full { ", full" } else { "" })
    }
}

/// Transmit event FIFO (register TXEFS, 0x9000:07).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct EventFifoStatus {
    /// Pending events, 0 to 32.
    pub fill: u8,
    /// The FIFO is full.
    pub is_full: bool,
    /// An event was lost.
    pub has_lost: bool,
}

impl EventFifoStatus {
    /// Decodes the register.
    pub const fn from_raw(raw: u32) -> Self {
        Self { fill: field(raw, 0, 0x3F), is_full: bit(raw, 24), has_lost: bit(raw, 25) }
    }
}

impl fmt::Display for EventFifoStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} events pending", self.fill)?;
        f.write_str(if self.is_full { ", full" } else { "" })?;
        f.write_str(if self.has_lost { ", event lost" } else { "" })
    }
}

/// Last high priority message (register HPMS, 0x9000:08).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct HighPriorityStatus {
    /// Index of the element.
    pub buffer: u8,
    /// Storage: 0 none, 1 lost, 2 RX FIFO0, 3 RX FIFO1.
    pub storage: u8,
    /// Index of the matching filter.
    pub filter: u8,
    /// The filter is an extended one.
    pub is_extended: bool,
}

impl HighPriorityStatus {
    /// Decodes the register.
    pub const fn from_raw(raw: u32) -> Self {
        Self {
            buffer: field(raw, 0, 0x3F),
            storage: field(raw, 6, 3),
            filter: field(raw, 8, 0x7F),
            is_extended: bit(raw, 15),
        }
    }
}

impl fmt::Display for HighPriorityStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.is_extended { "extended" } else { "standard" };
        let place = match self.storage {
            0 => return f.write_str("none in a FIFO"),
            1 => "lost".to_owned(),
            fifo => format!("in RX FIFO{}, element {}", fifo - 2, self.buffer),
        };
        write!(f, "{place}, by {kind} filter {}", self.filter)
    }
}
