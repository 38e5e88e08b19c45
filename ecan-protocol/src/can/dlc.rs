//! Data length code.

use core::fmt;

/// Data bytes of a CAN FD frame for each DLC (manual 8.2).
const FD_LENGTHS: [u8; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// Data length code of a CAN frame, 0 to 15 (manual 8.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Dlc(u8);

impl Dlc {
    /// Returns the code with this value; `None` above 15.
    pub const fn new(value: u8) -> Option<Self> {
        if value <= 15 { Some(Self(value)) } else { None }
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
    use super::Dlc;

    #[test]
    fn length_and_code_round_trip() {
        for value in 0..=15 {
            let dlc = Dlc::new(value).unwrap();
            assert_eq!(Dlc::from_fd_len(dlc.fd_len()), Some(dlc));
            assert_eq!(dlc.classic_len(), usize::from(value.min(8)));
        }
        assert_eq!(Dlc::new(16), None);
    }

    #[test]
    fn length_between_steps_has_no_code() {
        for length in [9, 11, 13, 63, 65, 4096] {
            assert_eq!(Dlc::from_fd_len(length), None, "{length}");
        }
        assert_eq!(Dlc::from_classic_len(9), None);
        assert_eq!(Dlc::from_classic_len(8), Dlc::new(8));
    }
}
