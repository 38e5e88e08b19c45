//! Schedule record of an RxPDO frame (manual 8.4, 13.8).

use super::diagnosis::PdoError;
use super::timestamp::Timestamp;

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

#[cfg(test)]
mod tests {
    use super::Schedule;
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
}
