//! A value as SDO carries it.

use core::fmt;

use crate::object::SdoWrite;

/// A value of up to eight bytes as SDO carries it, little-endian. Created from the integer type
/// that the object has: `Step::write(0x6060, 0, 8i8)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct SdoValue {
    bytes: [u8; 8],
    length: u8,
}

impl SdoValue {
    /// Takes the first eight of these little-endian bytes.
    pub fn from_bytes(source: &[u8]) -> Self {
        let mut bytes = [0; 8];
        for (to, from) in bytes.iter_mut().zip(source) {
            *to = *from;
        }
        Self { bytes, length: source.len().min(8) as u8 }
    }

    /// Bytes to send.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or_default()
    }

    /// Value without sign; missing bytes count as 0.
    pub fn raw(&self) -> u64 {
        u64::from_le_bytes(self.bytes)
    }
}

/// Hexadecimal, with as many digits as the value has bytes: `0x000F`.
impl fmt::Display for SdoValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = 2 + self.as_bytes().len() * 2;
        write!(f, "{:#0width$X}", self.raw())
    }
}

impl From<SdoWrite> for SdoValue {
    fn from(write: SdoWrite) -> Self {
        let (bytes, length) = write.bytes();
        Self::from_bytes(bytes.get(..length).unwrap_or_default())
    }
}

macro_rules! from_integer {
    ($($integer:ty),*) => {$(
        impl From<$integer> for SdoValue {
            fn from(value: $integer) -> Self {
                Self::from_bytes(&value.to_le_bytes())
            }
        }
    )*};
}

from_integer!(u8, u16, u32, u64, i8, i16, i32, i64);
