//! Timestamp field of a frame packet (manual 8.4).

use crate::mapping::Direction;
use crate::object::pdo_profile::EncapsulationProfile;

/// The timestamp field of a CAN_FRAME packet (manual 8.4).
///
/// In TxPDO it is the time of reception in the gateway; the manual gives no unit. Differences are
/// relative to the first time base of the same image, unsigned with wrap. In RxPDO only `None` (send
/// immediately) and `Full64` with a [`Schedule`](crate::image::Schedule) exist.
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

#[cfg(test)]
mod tests {
    use super::Timestamp;

    #[test]
    fn sizes_are_the_manuals() {
        assert_eq!(Timestamp::None.size(), 0);
        assert_eq!(Timestamp::Delta16(1).size(), 2);
        assert_eq!(Timestamp::Delta32(1).size(), 4);
        assert_eq!(Timestamp::Full64(1).size(), 8);
    }
}
