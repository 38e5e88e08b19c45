//! Errors of the encapsulation layer and their locations (manual 13.2, 16.2).

use core::fmt;

use super::header::Header;

crate::text_enum! {
    /// Errors of the encapsulation layer, with the values of 0x8010:14 and 0x8011:14 (manual 13.2).
    #[repr(u16)]
    pub enum PdoError: u16;
    Ok = 0, "no error";
    FrameOverrun = 2, "frame exceeds the encapsulation profile";
    PacketOverrun = 3, "packet exceeds the frame area";
    /// A packet of unknown or unsupported kind.
    UnknownKind = 4, "unknown packet kind";
    /// The DLC violates the rules of classic CAN or CAN FD.
    InvalidDlc = 5, "invalid DLC";
    /// The channel does not exist or is not in the channel mask.
    InvalidChannel = 6, "invalid channel";
    /// The timestamp format does not belong to the profile or direction.
    InvalidTsf = 7, "timestamp format not allowed by profile or direction";
    Truncated = 8, "packet truncated by the end of the payload";
    UnsupportedProfile = 9, "unsupported encapsulation profile";
    /// The same RxPDO image again.
    DuplicateSequence = 10, "duplicate sequence";
    UnsupportedOption = 11, "unsupported option flag";
    /// The frame area and the mapping of the master differ.
    ActiveArea = 12, "frame area and mapping disagree";
    ReservedBit = 13, "reserved bit set";
    /// Version, length or another field of the header is invalid.
    BadHeader = 14, "bad header";
    BadCrc = 15, "bad CRC";
    /// The schedule record is invalid or not supported.
    BadSchedule = 16, "bad schedule record";
}

impl core::error::Error for PdoError {}

/// Error: an image, or the rest of one, cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ImageFault {
    /// `seq_begin` and `seq_end` differ: the image was being written. Skip this cycle.
    Updating,
    /// The header changed while the payload was checked. Skip this cycle.
    Torn,
    /// An error of the encapsulation layer.
    Pdo(PdoError),
}

impl fmt::Display for ImageFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Updating => f.write_str("image is being updated"),
            Self::Torn => f.write_str("image changed while it was read"),
            Self::Pdo(error) => error.fmt(f),
        }
    }
}

/// The header fields of a diagnosis: small, so that iterators over packets can hold it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HeaderExcerpt {
    sequence: u16,
    payload_len: u16,
    payload_crc16: u16,
    layout_id: u16,
}

impl HeaderExcerpt {
    #[inline]
    pub(crate) const fn of(header: &Header) -> Self {
        Self {
            sequence: header.seq_begin,
            payload_len: header.payload_len,
            payload_crc16: header.payload_crc16,
            layout_id: header.layout_id,
        }
    }
}

/// The fault of an image and its location, with the fields of manual 16.2.
///
/// Fields that do not apply to the fault are 0: packet fields for faults of the whole image,
/// `computed_crc16` if no CRC was computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParseDiagnosis {
    /// The fault.
    pub fault: ImageFault,
    /// Offset of the faulty packet in the image, in bytes; 0 for the header.
    pub offset: u16,
    /// Offset after that packet, padding included, if it is known.
    pub packet_end: u16,
    /// Control word of the packet.
    pub ctrl: u16,
    /// Sequence number of the image (`seq_begin`).
    pub sequence: u16,
    /// `payload_len` of the header.
    pub payload_len: u16,
    /// `payload_crc16` of the header.
    pub payload_crc16: u16,
    /// CRC of the payload as received.
    pub computed_crc16: u16,
    /// `layout_id` of the header.
    pub layout_id: u16,
    /// Channel of the packet.
    pub channel: u8,
    /// DLC of the packet.
    pub dlc: u8,
    /// Timestamp format of the packet.
    pub tsf: u8,
    /// Kind of the packet.
    pub kind: u8,
}

impl ParseDiagnosis {
    /// A fault of the image as a whole.
    // Inlined, so that readers keep the header in registers.
    #[inline(always)]
    pub(crate) const fn of_image(header: &Header, fault: ImageFault, computed_crc16: u16) -> Self {
        Self::of_excerpt(HeaderExcerpt::of(header), fault, computed_crc16)
    }

    /// A fault of the image as a whole, from the kept header fields.
    #[cold]
    #[inline(never)]
    pub(crate) const fn of_excerpt(
        header: HeaderExcerpt,
        fault: ImageFault,
        computed_crc16: u16,
    ) -> Self {
        Self {
            fault,
            offset: 0,
            packet_end: 0,
            ctrl: 0,
            sequence: header.sequence,
            payload_len: header.payload_len,
            payload_crc16: header.payload_crc16,
            computed_crc16,
            layout_id: header.layout_id,
            channel: 0,
            dlc: 0,
            tsf: 0,
            kind: 0,
        }
    }

    /// The error of the encapsulation layer; `None` if the image was only being updated.
    pub const fn pdo_error(&self) -> Option<PdoError> {
        match self.fault {
            ImageFault::Pdo(error) => Some(error),
            ImageFault::Updating | ImageFault::Torn => None,
        }
    }
}

impl fmt::Display for ParseDiagnosis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} in image {}", self.fault, self.sequence)?;
        if self.fault == ImageFault::Pdo(PdoError::BadCrc) {
            write!(
                f,
                ": {:#06x} computed, {:#06x} in the header",
                self.computed_crc16, self.payload_crc16
            )?;
        }
        if self.offset != 0 {
            write!(
                f,
                " at offset {} to {}: control word {:#06x}, kind {}, channel {}, DLC {}, TSF {}",
                self.offset,
                self.packet_end,
                self.ctrl,
                self.kind,
                self.channel,
                self.dlc,
                self.tsf
            )?;
        }
        write!(f, " (payload of {} bytes, layout {:#06x})", self.payload_len, self.layout_id)
    }
}

impl core::error::Error for ParseDiagnosis {}

#[cfg(test)]
mod tests {
    use super::PdoError;

    #[test]
    fn values_match_the_manual() {
        for raw in 0..=17 {
            match PdoError::from_raw(raw) {
                Some(error) => assert_eq!(error.raw(), raw),
                None => assert!(raw == 1 || raw == 17, "{raw}"),
            }
        }
    }
}
