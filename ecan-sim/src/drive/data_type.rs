//! Data types of CiA 301 for a dictionary of values.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DataType {
    /// 0 or 1 in one byte.
    Boolean,
    /// Two's complement; number of bytes, 1 to 8.
    Signed(u8),
    /// Number of bytes, 1 to 8.
    Unsigned(u8),
    /// IEEE 754; 4 or 8 bytes.
    Real(u8),
    /// ISO 646 characters.
    Text,
    Octets,
    /// UTF-16 characters.
    Unicode,
    /// Bytes of any length.
    Domain,
}

impl DataType {
    pub(super) const BOOLEAN: u16 = 0x01;
    pub(super) const U32: u16 = 0x07;
    pub(super) const U8: u16 = 0x05;

    pub(super) const fn from_index(index: u16) -> Option<Self> {
        Some(match index {
            Self::BOOLEAN => Self::Boolean,
            0x02 => Self::Signed(1),
            0x03 => Self::Signed(2),
            0x04 => Self::Signed(4),
            Self::U8 => Self::Unsigned(1),
            0x06 => Self::Unsigned(2),
            Self::U32 => Self::Unsigned(4),
            0x08 => Self::Real(4),
            0x09 => Self::Text,
            0x0A => Self::Octets,
            0x0B => Self::Unicode,
            // time of day and time difference: 28 bits of milliseconds, 4 reserved, 16 of days
            0x0C | 0x0D => Self::Unsigned(6),
            0x0F => Self::Domain,
            0x10 => Self::Signed(3),
            0x11 => Self::Real(8),
            0x12 => Self::Signed(5),
            0x13 => Self::Signed(6),
            0x14 => Self::Signed(7),
            0x15 => Self::Signed(8),
            0x16 => Self::Unsigned(3),
            0x18 => Self::Unsigned(5),
            0x19 => Self::Unsigned(6),
            0x1A => Self::Unsigned(7),
            0x1B => Self::Unsigned(8),
            _ => return None,
        })
    }

    /// Size in bytes; `None` if the size depends on the value.
    pub(super) const fn size(self) -> Option<usize> {
        match self {
            Self::Boolean => Some(1),
            Self::Signed(bytes) | Self::Unsigned(bytes) | Self::Real(bytes) => Some(bytes as usize),
            Self::Text | Self::Octets | Self::Unicode | Self::Domain => None,
        }
    }

    /// Size in bits in a PDO; `None` if the type cannot be mapped.
    pub(super) const fn bits(self) -> Option<u8> {
        match self.size() {
            Some(bytes) => Some(8 * bytes as u8),
            None => None,
        }
    }

    /// The sign-extended value of little-endian bits.
    pub(super) const fn number(self, raw: u64) -> i64 {
        match self {
            Self::Signed(bytes) if bytes < 8 => {
                let unused = 64 - 8 * bytes as u32;
                ((raw << unused) as i64) >> unused
            }
            _ => raw as i64,
        }
    }

    /// Minimum and maximum of an integer type narrower than 64 bits.
    pub(super) const fn range(self) -> Option<(i64, i64)> {
        match self {
            Self::Boolean => Some((0, 1)),
            Self::Signed(bytes) if bytes < 8 => {
                let half = 1i64 << (8 * bytes as u32 - 1);
                Some((-half, half - 1))
            }
            Self::Unsigned(bytes) if bytes < 8 => Some((0, (1i64 << (8 * bytes as u32)) - 1)),
            _ => None,
        }
    }

    /// Masks the bits that a value of this type has.
    pub(super) const fn cut(self, raw: u64) -> u64 {
        match self.size() {
            Some(bytes) if bytes < 8 => raw & ((1 << (8 * bytes as u32)) - 1),
            _ => raw,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::DataType;

    #[test]
    fn sign_is_extended_from_type_width() {
        assert_eq!(DataType::Signed(1).number(0xFF), -1);
        assert_eq!(DataType::Signed(3).number(0x80_0000), -0x80_0000);
        assert_eq!(DataType::Signed(4).number(0xFFFF_FF9C), -100);
        assert_eq!(DataType::Signed(8).number(u64::MAX), -1);
        assert_eq!(DataType::Unsigned(4).number(0xFFFF_FFFF), 0xFFFF_FFFF);
        assert_eq!(DataType::Signed(2).range(), Some((-32768, 32767)));
        assert_eq!(DataType::Unsigned(1).range(), Some((0, 255)));
        assert_eq!(DataType::Signed(4).cut((-1i64) as u64), 0xFFFF_FFFF);
    }
}
