//! Packets of the frame area (manual 8, 10).

use super::diagnosis::PdoError;
use super::schedule::Schedule;
use super::timestamp::Timestamp;
use super::tx_result::TxResult;
use crate::can::FrameRef;
use crate::mapping::Direction;

/// Bytes of the control word.
pub(crate) const CONTROL_BYTES: usize = 2;
/// Bytes of a TX_RESULT packet before padding.
pub(crate) const TX_RESULT_BYTES: usize = 6;
pub(crate) const WINDOW_BYTES: usize = 64;
/// First bit of ID_AUX in the CAN ID field.
pub(crate) const STANDARD_AUX_SHIFT: u32 = 11;
/// CAN ID and ID_AUX of a standard frame; the bits above are reserved.
pub(crate) const STANDARD_FIELD_BITS: u32 = 14;
pub(crate) const EXTENDED_AUX_SHIFT: u32 = 29;

/// A CAN_FRAME packet as read from an image (manual 8.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FramePacket<'a> {
    /// Direction of the image: received from the bus (TxPDO) or to be sent (RxPDO).
    pub direction: Direction,
    /// Channel, 0 to 3.
    pub channel: u8,
    /// ID_AUX, 0 to 7. TxPDO: 0 FIFO0, 1 FIFO1, 2 dedicated buffer, 3 high priority. RxPDO: 0
    /// normal, 1 high priority, 2 dedicated buffer, 3 queue.
    pub id_aux: u8,
    /// The frame; its data lies in the image.
    pub frame: FrameRef<'a>,
    /// Timestamp field.
    pub timestamp: Timestamp,
    /// Index among the CAN_FRAME packets of the image, from 0; TX_RESULT refers to it.
    pub index: u8,
    /// Offset of the packet in the image, in bytes.
    pub offset: u16,
}

impl FramePacket<'_> {
    /// The schedule record of an RxPDO frame with a full64 field; `None` for every other packet.
    ///
    /// A record with an invalid format gives [`PdoError::BadSchedule`]; the packets after it are still
    /// readable.
    pub const fn schedule(&self) -> Option<Result<Schedule, PdoError>> {
        match (self.direction, self.timestamp) {
            (Direction::RxPdo, Timestamp::Full64(bits)) => {
                Some(Schedule::from_bytes(bits.to_le_bytes()))
            }
            _ => None,
        }
    }
}

/// A packet of the frame area.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packet<'a> {
    /// KIND 0: a CAN frame.
    Frame(FramePacket<'a>),
    /// KIND 1: the result of a frame sent earlier. TxPDO only.
    TxResult(TxResult),
}
