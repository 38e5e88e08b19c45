//! Values of an object dictionary: in a file, in an SDO and as text; and what is wrong with them.

use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;

use super::data_type::{DataType, ValueClass};
use crate::NodeId;

/// Value of an object, of the kind that its [`DataType`] states.
///
/// Reals are equal if their bits are equal, so that a value is always equal to itself.
#[derive(Clone, Debug)]
pub enum DataValue {
    /// BOOLEAN.
    Boolean(bool),
    /// INTEGER8 to INTEGER64.
    Signed(i64),
    /// UNSIGNED8 to UNSIGNED64.
    Unsigned(u64),
    /// REAL32.
    Real32(f32),
    /// REAL64.
    Real64(f64),
    /// VISIBLE_STRING and UNICODE_STRING.
    Text(String),
    /// OCTET_STRING, DOMAIN and types that CiA 301 does not define.
    Bytes(Vec<u8>),
    /// TIME_OF_DAY and TIME_DIFFERENCE.
    Time {
        /// Days; of a TIME_OF_DAY since 1984-01-01.
        days: u16,
        /// Milliseconds, 28 bits; of a TIME_OF_DAY after midnight.
        milliseconds: u32,
    },
}

/// Bits of milliseconds in a time.
pub(super) const TIME_MASK: u32 = 0x0FFF_FFFF;

impl PartialEq for DataValue {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Boolean(a), Self::Boolean(b)) => a == b,
            (Self::Signed(a), Self::Signed(b)) => a == b,
            (Self::Unsigned(a), Self::Unsigned(b)) => a == b,
            (Self::Real32(a), Self::Real32(b)) => a.to_bits() == b.to_bits(),
            (Self::Real64(a), Self::Real64(b)) => a.to_bits() == b.to_bits(),
            (Self::Text(a), Self::Text(b)) => a == b,
            (Self::Bytes(a), Self::Bytes(b)) => a == b,
            (
                Self::Time { days, milliseconds },
                Self::Time { days: other_days, milliseconds: other_milliseconds },
            ) => days == other_days && milliseconds == other_milliseconds,
            _ => false,
        }
    }
}

impl Eq for DataValue {}

impl DataValue {
    /// The value as a number, if it is a BOOLEAN or an integer.
    #[must_use]
    pub fn to_integer(&self) -> Option<i128> {
        match self {
            Self::Boolean(value) => Some((*value).into()),
            Self::Signed(value) => Some((*value).into()),
            Self::Unsigned(value) => Some((*value).into()),
            _ => None,
        }
    }

    fn kind(&self) -> &'static str {
        match self {
            Self::Boolean(_) => "a BOOLEAN",
            Self::Signed(_) | Self::Unsigned(_) => "an integer",
            Self::Real32(_) => "a REAL32",
            Self::Real64(_) => "a REAL64",
            Self::Text(_) => "a text",
            Self::Bytes(_) => "a sequence of bytes",
            Self::Time { .. } => "a time",
        }
    }
}

impl fmt::Display for DataValue {
    /// Integers in decimal, unsigned ones in hexadecimal with `{:#}`; bytes as pairs of hexadecimal
    /// digits; times as `3 d 04:05:06.789`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Boolean(value) => write!(f, "{}", u8::from(*value)),
            Self::Signed(value) => write!(f, "{value}"),
            Self::Unsigned(value) if f.alternate() => write!(f, "{value:#X}"),
            Self::Unsigned(value) => write!(f, "{value}"),
            Self::Real32(value) => write!(f, "{value}"),
            Self::Real64(value) => write!(f, "{value}"),
            Self::Text(text) => f.write_str(text),
            Self::Bytes(bytes) => {
                for (position, byte) in bytes.iter().enumerate() {
                    let separator = if position == 0 { "" } else { " " };
                    write!(f, "{separator}{byte:02X}")?;
                }
                Ok(())
            }
            Self::Time { days, milliseconds } => {
                let seconds = milliseconds / 1000;
                let (hours, minutes) = (seconds / 3600, seconds / 60 % 60);
                let (seconds, rest) = (seconds % 60, milliseconds % 1000);
                write!(f, "{days} d {hours:02}:{minutes:02}:{seconds:02}.{rest:03}")
            }
        }
    }
}

impl DataType {
    /// The value of an integer type or BOOLEAN with this number, excess bits cut off; `None` for
    /// other types.
    pub(super) fn integer(self, number: i128) -> Option<DataValue> {
        let raw = self.mask(number as u64);
        Some(match self.class() {
            ValueClass::Boolean => DataValue::Boolean(raw & 1 == 1),
            ValueClass::Signed => DataValue::Signed(self.sign_extend(raw)),
            ValueClass::Unsigned => DataValue::Unsigned(raw),
            _ => return None,
        })
    }

    /// Decodes the bytes of an SDO.
    ///
    /// Zeros at the end of a VISIBLE_STRING or UNICODE_STRING are padding and are removed. A
    /// BOOLEAN is true if its byte is not 0.
    ///
    /// # Errors
    /// [`ValueError::Length`] if the number of bytes is not that of the type.
    pub fn decode(self, bytes: &[u8]) -> Result<DataValue, ValueError> {
        let wrong = ValueError::Length { data_type: self, found: bytes.len() };
        if self.size().is_some_and(|size| size != bytes.len()) {
            return Err(wrong);
        }
        let raw = || bytes.iter().rev().fold(0u64, |raw, byte| raw << 8 | u64::from(*byte));
        Ok(match self {
            Self::Boolean => DataValue::Boolean(raw() != 0),
            Self::Real32 => DataValue::Real32(f32::from_bits(raw() as u32)),
            Self::Real64 => DataValue::Real64(f64::from_bits(raw())),
            Self::VisibleString => {
                let text: String = bytes.iter().map(|byte| char::from(*byte)).collect();
                DataValue::Text(text.trim_end_matches('\0').into())
            }
            Self::UnicodeString => {
                let (units, rest) = bytes.as_chunks::<2>();
                if !rest.is_empty() {
                    return Err(wrong);
                }
                let units = units.iter().map(|unit| u16::from_le_bytes(*unit));
                let text: String = char::decode_utf16(units)
                    .map(|character| character.unwrap_or(char::REPLACEMENT_CHARACTER))
                    .collect();
                DataValue::Text(text.trim_end_matches('\0').into())
            }
            Self::TimeOfDay | Self::TimeDifference => DataValue::Time {
                days: (raw() >> 32) as u16,
                milliseconds: raw() as u32 & TIME_MASK,
            },
            _ => self.integer(raw().into()).unwrap_or_else(|| DataValue::Bytes(bytes.to_vec())),
        })
    }

    /// Encodes a value as the bytes of an SDO.
    ///
    /// Integers, signed or unsigned, may be given for every integer type that can hold them.
    ///
    /// # Errors
    /// - [`ValueError::Kind`] if the value is of another kind;
    /// - [`ValueError::OutOfRange`] if an integer does not fit;
    /// - [`ValueError::Character`] if a VISIBLE_STRING has a character above U+00FF.
    pub fn encode(self, value: &DataValue) -> Result<Vec<u8>, ValueError> {
        let wrong = || ValueError::Kind { kind: value.kind(), data_type: self };
        Ok(match (self.class(), value) {
            (ValueClass::Boolean | ValueClass::Signed | ValueClass::Unsigned, value) => {
                let number = value.to_integer().ok_or_else(wrong)?;
                let (low, high) = self.range().unwrap_or_default();
                if !(low..=high).contains(&number) {
                    let text = alloc::format!("{number}");
                    return Err(ValueError::OutOfRange { text, data_type: self, low, high });
                }
                let size = self.size().unwrap_or(8);
                (number as u64).to_le_bytes().into_iter().take(size).collect()
            }
            (ValueClass::Real, DataValue::Real32(real)) if self == Self::Real32 => {
                real.to_bits().to_le_bytes().to_vec()
            }
            (ValueClass::Real, DataValue::Real64(real)) if self == Self::Real64 => {
                real.to_bits().to_le_bytes().to_vec()
            }
            (ValueClass::Text, DataValue::Text(text)) if self == Self::UnicodeString => {
                text.encode_utf16().flat_map(u16::to_le_bytes).collect()
            }
            (ValueClass::Text, DataValue::Text(text)) => {
                let byte = |character: char| {
                    u8::try_from(u32::from(character))
                        .map_err(|_| ValueError::Character { character, data_type: self })
                };
                text.chars().map(byte).collect::<Result<_, _>>()?
            }
            (ValueClass::Time, DataValue::Time { days, milliseconds }) => {
                let mut bytes = (milliseconds & TIME_MASK).to_le_bytes().to_vec();
                bytes.extend(days.to_le_bytes());
                bytes
            }
            (ValueClass::Bytes, DataValue::Bytes(bytes)) => bytes.clone(),
            _ => return Err(wrong()),
        })
    }
}

/// Reason why a value cannot be read, encoded or decoded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ValueError {
    /// The text is not a number.
    #[error("`{text}` is not a number; allowed: decimal, hexadecimal with 0x, octal with 0")]
    NotANumber {
        /// Text.
        text: String,
    },
    /// The number does not fit into the type.
    #[error("{text} is out of range for {data_type}; allowed: {low} to {high}")]
    OutOfRange {
        /// Text.
        text: String,
        /// Type.
        data_type: DataType,
        /// Smallest value.
        low: i128,
        /// Largest value.
        high: i128,
    },
    /// The text is not a sequence of bytes.
    #[error("`{text}` is not a sequence of bytes; allowed: pairs of hexadecimal digits")]
    NotBytes {
        /// Text.
        text: String,
    },
    /// The text has a character that the type cannot hold.
    #[error(
        "{character:?} is not a character of {data_type}; allowed: characters up to U+00FF (ISO \
         8859-1)"
    )]
    Character {
        /// First such character.
        character: char,
        /// Type.
        data_type: DataType,
    },
    /// The number of bytes is not that of the type.
    #[error("{data_type} cannot have {found} bytes; allowed: {}", sizes(*.data_type))]
    Length {
        /// Type.
        data_type: DataType,
        /// Number of bytes.
        found: usize,
    },
    /// The value is of another kind than the type.
    #[error("{kind} cannot be encoded as {data_type}; use a value of this type")]
    Kind {
        /// Kind of the value.
        kind: &'static str,
        /// Type.
        data_type: DataType,
    },
}

fn sizes(data_type: DataType) -> String {
    match data_type.size() {
        Some(size) => alloc::format!("{size} bytes"),
        None if data_type == DataType::UnicodeString => "an even number of bytes".into(),
        None => "any number of bytes".into(),
    }
}

/// Value in a device file, which may depend on the node-ID (CiA 306-1, `$NODEID`).
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileValue {
    /// The same value for every node.
    Fixed(DataValue),
    /// The node-ID plus a number, for integer types.
    NodeId {
        /// Number that is added to the node-ID.
        offset: i64,
    },
}

impl FileValue {
    /// The value for a node; excess bits of a sum are cut off.
    #[must_use]
    pub fn resolve(&self, data_type: DataType, node: NodeId) -> DataValue {
        match self {
            Self::Fixed(value) => value.clone(),
            Self::NodeId { offset } => {
                let sum = i128::from(*offset) + i128::from(node.get());
                data_type.integer(sum).unwrap_or(DataValue::Unsigned(sum as u64))
            }
        }
    }
}

impl From<DataValue> for FileValue {
    fn from(value: DataValue) -> Self {
        Self::Fixed(value)
    }
}

#[cfg(test)]
mod tests {
    use alloc::format;

    use super::*;

    #[test]
    fn display_shows_each_kind() {
        let time = DataValue::Time { days: 3, milliseconds: 14_706_789 };
        assert_eq!(format!("{time}"), "3 d 04:05:06.789");
        assert_eq!(format!("{}", DataValue::Bytes(alloc::vec![1, 0xAB])), "01 AB");
        assert_eq!(format!("{:#}", DataValue::Unsigned(0x1A)), "0x1A");
        assert_eq!(format!("{:#}", DataValue::Signed(-1)), "-1");
        assert_eq!(format!("{}", DataValue::Real32(0.1)), "0.1");
    }

    #[test]
    fn bytes_follow_cia_301() {
        let encode = |data_type: DataType, value| data_type.encode(&value).unwrap();
        // CiA 301, 7.1.4.4: -1 of INTEGER16 and 0x12345678 of UNSIGNED32, least significant first
        assert_eq!(encode(DataType::Integer16, DataValue::Signed(-1)), [0xFF, 0xFF]);
        assert_eq!(
            encode(DataType::Unsigned32, DataValue::Unsigned(0x1234_5678)),
            [0x78, 0x56, 0x34, 0x12]
        );
        assert_eq!(encode(DataType::Integer24, DataValue::Signed(-2)), [0xFE, 0xFF, 0xFF]);
        // IEEE 754 single: 1.0 is 0x3F800000
        assert_eq!(encode(DataType::Real32, DataValue::Real32(1.0)), [0, 0, 0x80, 0x3F]);
        assert_eq!(encode(DataType::VisibleString, DataValue::Text("aÜ".into())), [0x61, 0xDC]);
        assert_eq!(
            encode(DataType::UnicodeString, DataValue::Text("aÜ".into())),
            [0x61, 0, 0xDC, 0]
        );
        let time = DataValue::Time { days: 0x0102, milliseconds: 0x0304_0506 };
        assert_eq!(encode(DataType::TimeOfDay, time), [0x06, 0x05, 0x04, 0x03, 0x02, 0x01]);
    }

    #[test]
    fn wrong_values_are_rejected_with_type_and_range() {
        let error = DataType::Unsigned8.encode(&DataValue::Signed(256)).unwrap_err();
        assert_eq!(format!("{error}"), "256 is out of range for UNSIGNED8; allowed: 0 to 255");
        let error = DataType::Unsigned8.encode(&DataValue::Text("5".into())).unwrap_err();
        assert!(matches!(error, ValueError::Kind { kind: "a text", .. }));
        let error = DataType::VisibleString.encode(&DataValue::Text("a€".into())).unwrap_err();
        assert!(matches!(error, ValueError::Character { character: '€', .. }));
        let error = DataType::Unsigned16.decode(&[1]).unwrap_err();
        assert_eq!(format!("{error}"), "UNSIGNED16 cannot have 1 bytes; allowed: 2 bytes");
        assert!(DataType::UnicodeString.decode(&[1]).is_err());
    }
}
