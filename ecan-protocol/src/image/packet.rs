//! Packets of the frame area with their timestamps and transmit results (manual 8, 10).

use super::diagnosis::PdoError;
use crate::can::FrameRef;
use crate::mapping::Direction;
use crate::object::pdo_profile::EncapsulationProfile;

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

const FORMAT: u8 = 1;

/// Time at which an RxPDO frame is sent, relative to DC Sync0 (manual 8.4).
///
/// It replaces a full64 timestamp. The gateway drops a frame whose phase is past. The gateway must have
/// feature bit 8 of 0xF000:16.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Schedule {
    /// Tag of the application.
    pub tag: u16,
    /// Phase after the start of the next Sync0 cycle, in nanoseconds.
    pub offset_ns: u32,
}

impl Schedule {
    /// The record as in the packet.
    pub const fn to_bytes(self) -> [u8; 8] {
        let tag = self.tag.to_le_bytes();
        let offset = self.offset_ns.to_le_bytes();
        [FORMAT, 0, tag[0], tag[1], offset[0], offset[1], offset[2], offset[3]]
    }

    /// Reads the record.
    ///
    /// # Errors
    /// [`PdoError::BadSchedule`] if the format is not 1 or the flags are not 0.
    pub const fn from_bytes(bytes: [u8; 8]) -> Result<Self, PdoError> {
        let [FORMAT, 0, tag0, tag1, o0, o1, o2, o3] = bytes else {
            return Err(PdoError::BadSchedule);
        };
        Ok(Self {
            tag: u16::from_le_bytes([tag0, tag1]),
            offset_ns: u32::from_le_bytes([o0, o1, o2, o3]),
        })
    }

    /// The record as the timestamp field that carries it.
    pub const fn to_timestamp(self) -> Timestamp {
        Timestamp::Full64(u64::from_le_bytes(self.to_bytes()))
    }
}

/// The timestamp field of a CAN_FRAME packet (manual 8.4).
///
/// In TxPDO it is the time of reception in the gateway; the manual gives no unit. Differences are
/// relative to the first time base of the same image, unsigned with wrap. In RxPDO only `None` (send
/// immediately) and `Full64` with a [`Schedule`] exist.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Timestamp {
    /// No timestamp.
    #[default]
    None,
    /// Low 16 bits of the difference to the image's time base.
    Delta16(u16),
    /// Low 32 bits of the difference to the image's time base.
    Delta32(u32),
    /// The whole time, or the eight bytes of a schedule record (little endian).
    Full64(u64),
}

impl Timestamp {
    /// The format code TSF of the control word, 0 to 3.
    #[inline]
    pub const fn format(&self) -> u8 {
        match self {
            Self::None => 0,
            Self::Delta16(_) => 1,
            Self::Delta32(_) => 2,
            Self::Full64(_) => 3,
        }
    }

    /// Bytes of the field in the packet: 0, 2, 4 or 8.
    #[inline]
    pub const fn size(&self) -> usize {
        format_size(self.format())
    }
}

/// Bytes of the timestamp field for a TSF code.
#[inline]
pub(crate) const fn format_size(tsf: u8) -> usize {
    (1 << (tsf & 3)) & 0b1110
}

/// TSF codes that a direction allows with a profile, one bit for each code.
///
/// Profiles without timestamps have none in TxPDO; the others have every form, because the manual calls
/// delta32 and full64 extensions of the same capability (manual 3, 8.4). RxPDO has only immediate and
/// scheduled transmission, with every profile.
pub(crate) const fn allowed_formats(direction: Direction, profile: EncapsulationProfile) -> u8 {
    match direction {
        Direction::RxPdo => 0b1001,
        Direction::TxPdo if profile.allows_delta16() => 0b1111,
        Direction::TxPdo => 0b0001,
    }
}

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
    use super::{ResultCode, Schedule, Timestamp};
    use crate::image::PdoError;

    #[test]
    fn bytes_are_the_manuals() {
        let schedule = Schedule { tag: 0x1234, offset_ns: 100_000 };
        let bytes = [1, 0, 0x34, 0x12, 0xA0, 0x86, 0x01, 0x00];
        assert_eq!(schedule.to_bytes(), bytes);
        assert_eq!(Schedule::from_bytes(bytes), Ok(schedule));
    }

    #[test]
    fn other_formats_and_flags_are_rejected() {
        assert_eq!(Schedule::from_bytes([2, 0, 0, 0, 0, 0, 0, 0]), Err(PdoError::BadSchedule));
        assert_eq!(Schedule::from_bytes([1, 1, 0, 0, 0, 0, 0, 0]), Err(PdoError::BadSchedule));
    }

    #[test]
    fn sizes_are_the_manuals() {
        assert_eq!(Timestamp::None.size(), 0);
        assert_eq!(Timestamp::Delta16(1).size(), 2);
        assert_eq!(Timestamp::Delta32(1).size(), 4);
        assert_eq!(Timestamp::Full64(1).size(), 8);
    }

    #[test]
    fn result_code_round_trip() {
        for raw in 0..=255 {
            assert_eq!(ResultCode::from_raw(raw).raw(), raw);
        }
        assert!(ResultCode::Queued.is_success());
        assert!(!ResultCode::TxFifoFull.is_success());
    }
}
