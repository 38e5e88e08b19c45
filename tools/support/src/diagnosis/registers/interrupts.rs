//! IR: interrupt flags.

use std::fmt;

use serde::Serialize;

use super::bit;
use crate::diagnosis::bit_names::set_names;

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
