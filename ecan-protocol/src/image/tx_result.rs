//! TX_RESULT packets (manual 10).

use core::fmt;

/// Result of an RxPDO frame inside the gateway (manual 10).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ResultCode {
    /// Passed to the CAN controller.
    Ok,
    /// Waits in the gateway's transmit queue.
    Queued,
    /// The bus is busy.
    BusBusy,
    /// The frame's channel does not exist or is not enabled.
    InvalidChannel,
    /// The transmit FIFO is full.
    TxFifoFull,
    /// The channel is off the bus.
    BusOff,
    /// A code that the manual does not list.
    Other(u8),
}

impl ResultCode {
    /// True if the frame is in the CAN controller or in its queue.
    #[inline]
    #[must_use]
    pub const fn is_success(self) -> bool {
        matches!(self, Self::Ok | Self::Queued)
    }

    /// Returns the code with this value.
    #[inline]
    #[must_use]
    pub const fn from_raw(raw: u8) -> Self {
        match raw {
            0 => Self::Ok,
            1 => Self::Queued,
            2 => Self::BusBusy,
            3 => Self::InvalidChannel,
            4 => Self::TxFifoFull,
            5 => Self::BusOff,
            other => Self::Other(other),
        }
    }

    /// The value as transmitted.
    #[inline]
    #[must_use]
    pub const fn raw(self) -> u8 {
        match self {
            Self::Ok => 0,
            Self::Queued => 1,
            Self::BusBusy => 2,
            Self::InvalidChannel => 3,
            Self::TxFifoFull => 4,
            Self::BusOff => 5,
            Self::Other(other) => other,
        }
    }
}

impl fmt::Display for ResultCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ok => "ok",
            Self::Queued => "queued",
            Self::BusBusy => "bus busy",
            Self::InvalidChannel => "invalid channel",
            Self::TxFifoFull => "transmit FIFO full",
            Self::BusOff => "bus-off",
            Self::Other(raw) => return write!(f, "result code {raw}"),
        })
    }
}

/// A TX_RESULT packet: the result of one frame of an earlier RxPDO image (manual 10).
///
/// It reports the transfer to the CAN controller, not the reception by a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TxResult {
    /// Channel, 0 to 7 in the packet (0 to 3 exist).
    pub channel: u8,
    /// Sequence number of the RxPDO image of the frame.
    pub sequence: u16,
    /// Index of the frame among the CAN_FRAME packets of that image, from 0.
    pub frame_index: u8,
    /// The result.
    pub code: ResultCode,
}

#[cfg(test)]
mod tests {
    use super::ResultCode;

    #[test]
    fn result_code_round_trip() {
        for raw in 0..=255 {
            assert_eq!(ResultCode::from_raw(raw).raw(), raw);
        }
        assert!(ResultCode::Queued.is_success());
        assert!(!ResultCode::TxFifoFull.is_success());
    }
}
