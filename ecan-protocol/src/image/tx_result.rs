//! TX_RESULT packets (manual 10).

crate::open_enum! {
    /// Result of an RxPDO frame inside the gateway (manual 10).
    pub enum ResultCode: u8 else Other, "result code";
    /// Passed to the CAN controller.
    Ok = 0, "ok";
    /// Waits in the gateway's transmit queue.
    Queued = 1, "queued";
    BusBusy = 2, "bus busy";
    /// The frame's channel does not exist or is not enabled.
    InvalidChannel = 3, "invalid channel";
    TxFifoFull = 4, "transmit FIFO full";
    BusOff = 5, "bus-off";
}

impl ResultCode {
    /// True if the frame is in the CAN controller or in its queue.
    #[inline]
    pub const fn is_success(self) -> bool {
        matches!(self, Self::Ok | Self::Queued)
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
