//! Control word of a frame packet with the data length code (manual 8).

use core::fmt;

use super::FrameError;

/// Kind of a packet, bits 13 and 14 of the control word.
pub(crate) const KIND_CAN_FRAME: u8 = 0;
pub(crate) const KIND_TX_RESULT: u8 = 1;

/// The 16-bit control word; the fields have the positions of the manual.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Hash)]
pub(crate) struct ControlWord(pub u16);

impl ControlWord {
    pub const IDE: u16 = 1 << 7;
    pub const FDF: u16 = 1 << 8;
    pub const BRS: u16 = 1 << 9;
    /// Remote request in a classic frame, error state indicator in a CAN FD frame.
    pub const X: u16 = 1 << 10;
    pub const D64: u16 = 1 << 15;
    /// The bits that belong to the CAN frame itself.
    pub const FRAME_BITS: u16 = 0x0F << 3 | Self::IDE | Self::FDF | Self::BRS | Self::X;

    const CHANNEL_BITS: u16 = 7;

    pub const fn tx_result(channel: u8) -> Self {
        Self((channel & 7) as u16 | (KIND_TX_RESULT as u16) << 13)
    }

    #[inline]
    pub const fn has(self, bits: u16) -> bool {
        self.0 & bits != 0
    }

    #[inline]
    pub const fn channel(self) -> u8 {
        self.0 as u8 & 7
    }

    #[inline]
    pub const fn dlc(self) -> Dlc {
        Dlc::from_low_bits((self.0 >> 3) as u8)
    }

    #[inline]
    pub const fn tsf(self) -> u8 {
        (self.0 >> 11) as u8 & 3
    }

    #[inline]
    pub const fn kind(self) -> u8 {
        (self.0 >> 13) as u8 & 3
    }

    /// Bytes of a plain packet: a valid CAN_FRAME without timestamp and window. 0 for other packets.
    #[inline]
    pub const fn plain_size(self) -> usize {
        // A table, since the next format cannot be predicted.
        let size = PLAIN_SIZES[(self.0 >> 3) as usize & 0xFF];
        if self.has(!(Self::CHANNEL_BITS | Self::FRAME_BITS)) { 0 } else { size as usize }
    }

    /// A plain classic frame of 8 bytes with a standard CAN ID.
    #[inline]
    pub const fn is_standard_of_eight(self) -> bool {
        self.0 & !7 == 8 << 3
    }

    /// A CAN FD frame of 64 bytes with a standard CAN ID, without timestamp and window.
    #[inline]
    pub const fn is_standard_of_64(self) -> bool {
        self.0 & !(7 | Self::BRS | Self::X) == Self::FDF | 15 << 3
    }

    /// A classic remote frame, which carries no data.
    #[inline]
    pub const fn is_remote(self) -> bool {
        self.0 & (Self::FDF | Self::X) == Self::X
    }
}

/// Bytes of plain packets, without padding, for bits 3 to 10 of the control word; 0 if they are not valid.
static PLAIN_SIZES: [u8; 256] = plain_sizes();

const fn plain_sizes() -> [u8; 256] {
    let mut sizes = [0; 256];
    let mut bits = 0;
    while bits < sizes.len() {
        let control = ControlWord((bits as u16) << 3);
        let is_fd = control.has(ControlWord::FDF);
        if is_fd || control.dlc().value() <= 8 && !control.has(ControlWord::BRS) {
            let id = if control.has(ControlWord::IDE) { 4 } else { 2 };
            let data = if control.is_remote() { 0 } else { control.dlc().fd_len() };
            sizes[bits] = (2 + id + data) as u8;
        }
        bits += 1;
    }
    sizes
}

/// Data bytes of a CAN FD frame for each DLC (manual 8.2).
const FD_LENGTHS: [u8; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// Data length code of a CAN frame, 0 to 15 (manual 8.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Dlc(u8);

impl Dlc {
    /// Returns the code with this value.
    ///
    /// # Errors
    /// [`FrameError::DlcRange`] above 15.
    pub const fn new(value: u8) -> Result<Self, FrameError> {
        if value <= 15 { Ok(Self(value)) } else { Err(FrameError::DlcRange { dlc: value }) }
    }

    /// Returns the code in received data; `None` above 15.
    pub const fn from_raw(raw: u8) -> Option<Self> {
        if raw <= 15 { Some(Self(raw)) } else { None }
    }

    /// Returns the code in the low four bits; the others are ignored.
    #[inline]
    pub(crate) const fn from_low_bits(bits: u8) -> Self {
        Self(bits & 0x0F)
    }

    /// The code itself, 0 to 15.
    #[inline]
    pub const fn value(self) -> u8 {
        self.0
    }

    /// Data bytes of a CAN FD frame with this code: 0 to 8, 12, 16, 20, 24, 32, 48 or 64.
    #[inline]
    pub const fn fd_len(self) -> usize {
        // infallible: the value never exceeds 15
        FD_LENGTHS[(self.0 & 0x0F) as usize] as usize
    }

    /// Data bytes of a classic CAN data frame with this code: the code, at most 8.
    #[inline]
    pub const fn classic_len(self) -> usize {
        if self.0 > 8 { 8 } else { self.0 as usize }
    }

    /// Returns the code whose CAN FD length is exactly `length` bytes; `None` if CAN FD has none.
    #[inline]
    pub const fn from_fd_len(length: usize) -> Option<Self> {
        let value = match length {
            0..=8 => length as u8,
            12 => 9,
            16 => 10,
            20 => 11,
            24 => 12,
            32 => 13,
            48 => 14,
            64 => 15,
            _ => return None,
        };
        Some(Self(value))
    }

    /// Returns the code for `length` bytes in a classic CAN frame; `None` above 8.
    #[inline]
    pub const fn from_classic_len(length: usize) -> Option<Self> {
        if length <= 8 { Some(Self(length as u8)) } else { None }
    }
}

impl fmt::Display for Dlc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

#[cfg(test)]
mod tests {
    use super::{ControlWord, Dlc, FrameError};

    #[test]
    fn fields_have_the_bits_of_the_manual() {
        let word = ControlWord(3 | 9 << 3 | 1 << 7 | 1 << 8 | 1 << 10 | 2 << 11 | 1 << 13);
        assert_eq!(word.channel(), 3);
        assert_eq!(word.dlc().value(), 9);
        assert!(word.has(ControlWord::IDE) && word.has(ControlWord::FDF));
        assert!(!word.has(ControlWord::BRS) && !word.has(ControlWord::D64));
        assert_eq!(word.tsf(), 2);
        assert_eq!(word.kind(), 1);
        assert!(!word.is_remote());
        assert!(ControlWord(1 << 10).is_remote());
    }

    #[test]
    fn plain_packets_have_no_timestamp_and_no_window() {
        for bits in 0..=u16::MAX {
            let word = ControlWord(bits);
            let plain = word.kind() == 0
                && word.tsf() == 0
                && !word.has(ControlWord::D64)
                && (word.has(ControlWord::FDF)
                    || !word.has(ControlWord::BRS) && word.dlc().value() <= 8);
            assert_eq!(word.plain_size() != 0, plain, "{bits:#06x}");
        }
    }

    #[test]
    fn plain_packet_has_the_size_of_its_fields() {
        assert_eq!(ControlWord(8 << 3).plain_size(), 12);
        assert_eq!(ControlWord(3 | ControlWord::IDE).plain_size(), 6);
        assert_eq!(ControlWord(8 << 3 | ControlWord::X).plain_size(), 4);
        let fd = ControlWord::FDF | ControlWord::X | ControlWord::IDE;
        assert_eq!(ControlWord(9 << 3 | fd).plain_size(), 18);
        assert_eq!(ControlWord(15 << 3 | fd).plain_size(), 70);
    }

    #[test]
    fn length_and_code_round_trip() {
        for value in 0..=15 {
            let dlc = Dlc::new(value).unwrap();
            assert_eq!(Dlc::from_fd_len(dlc.fd_len()), Some(dlc));
            assert_eq!(dlc.classic_len(), usize::from(value.min(8)));
        }
        assert_eq!(Dlc::new(16), Err(FrameError::DlcRange { dlc: 16 }));
    }

    #[test]
    fn length_between_steps_has_no_code() {
        for length in [9, 11, 13, 63, 65, 4096] {
            assert_eq!(Dlc::from_fd_len(length), None, "{length}");
        }
        assert_eq!(Dlc::from_classic_len(9), None);
        assert_eq!(Dlc::from_classic_len(8), Dlc::new(8).ok());
    }
}
