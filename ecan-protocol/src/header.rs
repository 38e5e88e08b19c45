//! Fixed header of a process data image (manual 6).

use core::fmt;

use crate::mapping::{CHANNELS, HEADER_BYTES};
use crate::status::ChannelStatus;

/// Version 1 and a header length of six words.
pub const VER_IHL: u8 = 0x16;
/// `crc_alg` of an image without CRC.
pub const CRC_ALG_NONE: u8 = 0;
/// `crc_alg` of an image with CRC-16/CCITT-FALSE.
pub const CRC_ALG_CCITT_FALSE: u8 = 1;

/// Flags of the image header (manual 6.1).
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct HeaderFlags(u8);

impl HeaderFlags {
    /// No flag.
    pub const NONE: Self = Self(0);
    /// Frames were left out because the frame area was full.
    pub const STREAM_TRUNCATED: Self = Self(1 << 0);
    /// A channel is in error, off the bus or congested.
    pub const ANY_CHANNEL_ERROR: Self = Self(1 << 1);
    /// The image holds TX_RESULT packets.
    pub const TX_RESULT_PRESENT: Self = Self(1 << 2);
    /// A channel status differs from the previous image.
    pub const STATUS_CHANGED: Self = Self(1 << 3);
    /// The sequence stepped from 0xFFFF to 0 with this image.
    pub const SEQ_WRAP: Self = Self(1 << 4);
    /// `overflow_sat` is valid.
    pub const OVERFLOW_SAT_VALID: Self = Self(1 << 5);
    /// All flags that the manual defines; the other bits are sent as 0 and ignored on receipt.
    pub const ALL: Self = Self(0x3F);

    /// From the byte as transmitted, reserved bits included.
    #[inline]
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
    }

    /// The byte.
    #[inline]
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Whether all flags of `other` are set.
    #[inline]
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// These flags and those of `other`.
    #[inline]
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// `with` where `on` holds.
    #[inline]
    #[must_use]
    pub const fn with_if(self, other: Self, on: bool) -> Self {
        if on { self.with(other) } else { self }
    }

    /// Whether no flag is set.
    #[inline]
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }
}

impl fmt::Debug for HeaderFlags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "HeaderFlags({:#04x})", self.0)
    }
}

/// The fixed header of an image, all fields as transmitted (manual 6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Header version (high four bits) and length in words of 4 bytes: [`VER_IHL`].
    pub ver_ihl: u8,
    /// Flags.
    pub flags: HeaderFlags,
    /// Sequence number of the image.
    pub seq_begin: u16,
    /// The same number, written last: an image is whole where both agree.
    pub seq_end: u16,
    /// Valid bytes of the frame area.
    pub payload_len: u16,
    /// CRC over the valid bytes of the frame area; 0 without CRC.
    pub payload_crc16: u16,
    /// Short identifier of the layout.
    pub layout_id: u16,
    /// Channels that take part.
    pub channel_mask: u8,
    /// Packets in the frame area.
    pub frame_count: u8,
    /// Overflows and truncations of this image, 255 for more.
    pub overflow_sat: u8,
    /// [`CRC_ALG_CCITT_FALSE`] or [`CRC_ALG_NONE`].
    pub crc_alg: u8,
    /// Status of each channel; filled by the gateway, 0 in RxPDO.
    pub channel_status: [ChannelStatus; CHANNELS],
}

impl Header {
    /// Takes the bytes apart; nothing is judged.
    #[inline]
    #[must_use]
    pub const fn parse(bytes: &[u8; HEADER_BYTES]) -> Self {
        const fn word(bytes: &[u8; HEADER_BYTES], at: usize) -> u16 {
            u16::from_le_bytes([bytes[at], bytes[at + 1]])
        }
        Self {
            ver_ihl: bytes[0],
            flags: HeaderFlags::from_bits(bytes[1]),
            seq_begin: word(bytes, 2),
            seq_end: word(bytes, 4),
            payload_len: word(bytes, 6),
            payload_crc16: word(bytes, 8),
            layout_id: word(bytes, 10),
            channel_mask: bytes[12],
            frame_count: bytes[13],
            overflow_sat: bytes[14],
            crc_alg: bytes[15],
            channel_status: [
                ChannelStatus::from_raw(word(bytes, 16)),
                ChannelStatus::from_raw(word(bytes, 18)),
                ChannelStatus::from_raw(word(bytes, 20)),
                ChannelStatus::from_raw(word(bytes, 22)),
            ],
        }
    }

    /// Writes all 24 bytes as they are. The order of publication is the writer's matter.
    #[inline]
    pub const fn write(&self, bytes: &mut [u8; HEADER_BYTES]) {
        const fn put(bytes: &mut [u8; HEADER_BYTES], at: usize, value: u16) {
            let value = value.to_le_bytes();
            bytes[at] = value[0];
            bytes[at + 1] = value[1];
        }
        bytes[0] = self.ver_ihl;
        bytes[1] = self.flags.bits();
        put(bytes, 2, self.seq_begin);
        put(bytes, 4, self.seq_end);
        put(bytes, 6, self.payload_len);
        put(bytes, 8, self.payload_crc16);
        put(bytes, 10, self.layout_id);
        bytes[12] = self.channel_mask;
        bytes[13] = self.frame_count;
        bytes[14] = self.overflow_sat;
        bytes[15] = self.crc_alg;
        put(bytes, 16, self.channel_status[0].raw());
        put(bytes, 18, self.channel_status[1].raw());
        put(bytes, 20, self.channel_status[2].raw());
        put(bytes, 22, self.channel_status[3].raw());
    }

    /// Whether both sequence numbers agree.
    #[inline]
    #[must_use]
    pub const fn is_settled(&self) -> bool {
        self.seq_begin == self.seq_end
    }

    /// Whether the sender left something out of the image.
    #[inline]
    #[must_use]
    pub const fn is_incomplete(&self) -> bool {
        self.overflow_sat != 0 || self.flags.contains(HeaderFlags::STREAM_TRUNCATED)
    }
}

#[cfg(test)]
mod tests {
    use super::Header;

    #[test]
    fn every_byte_has_its_place() {
        let bytes: [u8; 24] = core::array::from_fn(|i| i as u8);
        let header = Header::parse(&bytes);
        assert_eq!(header.ver_ihl, 0);
        assert_eq!(header.flags.bits(), 1);
        assert_eq!(header.seq_begin, 0x0302);
        assert_eq!(header.seq_end, 0x0504);
        assert_eq!(header.payload_len, 0x0706);
        assert_eq!(header.payload_crc16, 0x0908);
        assert_eq!(header.layout_id, 0x0B0A);
        assert_eq!(header.channel_mask, 12);
        assert_eq!(header.frame_count, 13);
        assert_eq!(header.overflow_sat, 14);
        assert_eq!(header.crc_alg, 15);
        assert_eq!(header.channel_status[3].raw(), 0x1716);
        let mut again = [0xFF; 24];
        header.write(&mut again);
        assert_eq!(again, bytes);
    }
}
