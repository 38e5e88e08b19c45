//! RXF0S, RXF1S, TXFQS, TXEFS and HPMS: fill levels of the Message RAM.

use std::fmt;

use super::{bit, field};

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
