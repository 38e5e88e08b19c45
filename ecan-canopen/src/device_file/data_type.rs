//! Types and accesses of the objects of a device file, with the data types of CiA 301 (7.4.7).

use core::fmt;

/// Data type of a value in an object dictionary (CiA 301, 7.4.7.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum DataType {
    /// BOOLEAN; 0 or 1 in one byte of an SDO.
    Boolean,
    /// INTEGER8.
    Integer8,
    /// INTEGER16.
    Integer16,
    /// INTEGER24.
    Integer24,
    /// INTEGER32.
    Integer32,
    /// INTEGER40.
    Integer40,
    /// INTEGER48.
    Integer48,
    /// INTEGER56.
    Integer56,
    /// INTEGER64.
    Integer64,
    /// UNSIGNED8.
    Unsigned8,
    /// UNSIGNED16.
    Unsigned16,
    /// UNSIGNED24.
    Unsigned24,
    /// UNSIGNED32.
    Unsigned32,
    /// UNSIGNED40.
    Unsigned40,
    /// UNSIGNED48.
    Unsigned48,
    /// UNSIGNED56.
    Unsigned56,
    /// UNSIGNED64.
    Unsigned64,
    /// REAL32 (IEEE 754).
    Real32,
    /// REAL64 (IEEE 754).
    Real64,
    /// VISIBLE_STRING: one byte per character.
    VisibleString,
    /// OCTET_STRING.
    OctetString,
    /// UNICODE_STRING: UTF-16, little-endian.
    UnicodeString,
    /// TIME_OF_DAY: 28 bits of milliseconds after midnight, 4 reserved bits, 16 bits of days since
    /// 1984-01-01.
    TimeOfDay,
    /// TIME_DIFFERENCE: 28 bits of milliseconds, 4 reserved bits, 16 bits of days.
    TimeDifference,
    /// DOMAIN: bytes of any length.
    Domain,
    /// Index of any other type, for example a structure (0x0020 to 0x003F) or a type of the
    /// manufacturer (0x0040 to 0x005F). Its values are bytes.
    Other(u16),
}

/// Class of the values of a type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ValueClass {
    Boolean,
    Signed,
    Unsigned,
    Real,
    Text,
    Time,
    Bytes,
}

/// One row: type, index, name of CiA 301, class, size in bytes (0 if the size depends on the value).
type Row = (DataType, u16, &'static str, ValueClass, usize);

const TYPES: [Row; 25] = {
    use DataType::*;
    use ValueClass as C;
    [
        (Boolean, 0x01, "BOOLEAN", C::Boolean, 1),
        (Integer8, 0x02, "INTEGER8", C::Signed, 1),
        (Integer16, 0x03, "INTEGER16", C::Signed, 2),
        (Integer32, 0x04, "INTEGER32", C::Signed, 4),
        (Unsigned8, 0x05, "UNSIGNED8", C::Unsigned, 1),
        (Unsigned16, 0x06, "UNSIGNED16", C::Unsigned, 2),
        (Unsigned32, 0x07, "UNSIGNED32", C::Unsigned, 4),
        (Real32, 0x08, "REAL32", C::Real, 4),
        (VisibleString, 0x09, "VISIBLE_STRING", C::Text, 0),
        (OctetString, 0x0A, "OCTET_STRING", C::Bytes, 0),
        (UnicodeString, 0x0B, "UNICODE_STRING", C::Text, 0),
        (TimeOfDay, 0x0C, "TIME_OF_DAY", C::Time, 6),
        (TimeDifference, 0x0D, "TIME_DIFFERENCE", C::Time, 6),
        (Domain, 0x0F, "DOMAIN", C::Bytes, 0),
        (Integer24, 0x10, "INTEGER24", C::Signed, 3),
        (Real64, 0x11, "REAL64", C::Real, 8),
        (Integer40, 0x12, "INTEGER40", C::Signed, 5),
        (Integer48, 0x13, "INTEGER48", C::Signed, 6),
        (Integer56, 0x14, "INTEGER56", C::Signed, 7),
        (Integer64, 0x15, "INTEGER64", C::Signed, 8),
        (Unsigned24, 0x16, "UNSIGNED24", C::Unsigned, 3),
        (Unsigned40, 0x18, "UNSIGNED40", C::Unsigned, 5),
        (Unsigned48, 0x19, "UNSIGNED48", C::Unsigned, 6),
        (Unsigned56, 0x1A, "UNSIGNED56", C::Unsigned, 7),
        (Unsigned64, 0x1B, "UNSIGNED64", C::Unsigned, 8),
    ]
};

impl DataType {
    /// The type with this index; [`Other`](Self::Other) if CiA 301 does not define it as a simple
    /// type.
    #[must_use]
    pub fn from_index(index: u16) -> Self {
        TYPES.iter().find(|row| row.1 == index).map_or(Self::Other(index), |row| row.0)
    }

    fn row(self) -> Option<&'static Row> {
        TYPES.iter().find(|row| row.0 == self)
    }

    /// Index of the type in the object dictionary.
    #[must_use]
    pub fn index(self) -> u16 {
        match self {
            Self::Other(index) => index,
            known => known.row().map_or(0, |row| row.1),
        }
    }

    pub(super) fn class(self) -> ValueClass {
        self.row().map_or(ValueClass::Bytes, |row| row.3)
    }

    /// Size of a value in an SDO, in bytes; `None` if the size depends on the value.
    #[must_use]
    pub const fn size(self) -> Option<usize> {
        Some(match self {
            Self::Boolean | Self::Integer8 | Self::Unsigned8 => 1,
            Self::Integer16 | Self::Unsigned16 => 2,
            Self::Integer24 | Self::Unsigned24 => 3,
            Self::Integer32 | Self::Unsigned32 | Self::Real32 => 4,
            Self::Integer40 | Self::Unsigned40 => 5,
            Self::Integer48 | Self::Unsigned48 | Self::TimeOfDay | Self::TimeDifference => 6,
            Self::Integer56 | Self::Unsigned56 => 7,
            Self::Integer64 | Self::Unsigned64 | Self::Real64 => 8,
            Self::VisibleString
            | Self::OctetString
            | Self::UnicodeString
            | Self::Domain
            | Self::Other(_) => return None,
        })
    }

    /// Length of a value in a PDO, in bits; `None` if a PDO cannot contain it. A BOOLEAN has one
    /// bit (CiA 301, 7.4.7.1).
    #[must_use]
    pub const fn pdo_bits(self) -> Option<u8> {
        match (self, self.size()) {
            (Self::Boolean, _) => Some(1),
            (_, Some(bytes)) => Some(8 * bytes as u8),
            (_, None) => None,
        }
    }

    /// Returns whether the type is INTEGER8 to INTEGER64.
    #[must_use]
    pub const fn is_signed(self) -> bool {
        matches!(
            self,
            Self::Integer8
                | Self::Integer16
                | Self::Integer24
                | Self::Integer32
                | Self::Integer40
                | Self::Integer48
                | Self::Integer56
                | Self::Integer64
        )
    }

    /// Returns whether the type is an integer, signed or unsigned.
    #[must_use]
    pub const fn is_integer(self) -> bool {
        self.is_signed()
            || matches!(
                self,
                Self::Unsigned8
                    | Self::Unsigned16
                    | Self::Unsigned24
                    | Self::Unsigned32
                    | Self::Unsigned40
                    | Self::Unsigned48
                    | Self::Unsigned56
                    | Self::Unsigned64
            )
    }

    /// Smallest and largest value of BOOLEAN and of the integer types; `None` for the others.
    #[must_use]
    pub const fn range(self) -> Option<(i128, i128)> {
        let Some(bytes) = self.size() else { return None };
        let values = 1i128 << (8 * bytes as u32);
        match self {
            Self::Boolean => Some((0, 1)),
            _ if self.is_signed() => Some((-values / 2, values / 2 - 1)),
            _ if self.is_integer() => Some((0, values - 1)),
            _ => None,
        }
    }

    /// The bits of a value that belong to this type; all 64 for types without fixed size.
    #[must_use]
    pub const fn mask(self, raw: u64) -> u64 {
        match self.size() {
            Some(bytes) if bytes < 8 => raw & ((1 << (8 * bytes as u32)) - 1),
            _ => raw,
        }
    }

    /// Number with these little-endian bits, sign-extended for the signed types.
    #[must_use]
    pub const fn sign_extend(self, raw: u64) -> i64 {
        match self.size() {
            Some(bytes) if bytes < 8 && self.is_signed() => {
                let unused = 64 - 8 * bytes as u32;
                ((raw << unused) as i64) >> unused
            }
            _ => raw as i64,
        }
    }
}

impl fmt::Display for DataType {
    /// The name of CiA 301, for example `UNSIGNED32`; `type 0x0040` for [`DataType::Other`].
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.row() {
            Some(row) => f.write_str(row.2),
            None => write!(f, "type {:#06X}", self.index()),
        }
    }
}

/// Access to an object (CiA 306-1, `AccessType`), as seen from the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum AccessType {
    /// Readable; the value never changes.
    Const,
    /// Readable.
    ReadOnly,
    /// Writable.
    WriteOnly,
    /// Readable and writable.
    #[default]
    ReadWrite,
    /// Readable and writable; a TPDO may contain it.
    ReadWriteInput,
    /// Readable and writable; an RPDO may contain it.
    ReadWriteOutput,
}

impl AccessType {
    /// All types, in the order of their words in [`WORDS`](Self::WORDS).
    const ALL: [Self; 6] = [
        Self::Const,
        Self::ReadOnly,
        Self::WriteOnly,
        Self::ReadWrite,
        Self::ReadWriteInput,
        Self::ReadWriteOutput,
    ];
    /// Allowed words of a file.
    pub(super) const WORDS: &str = "const, ro, wo, rw, rwr, rww";

    /// The access with this word, without regard to case.
    pub(super) fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|access| access.word().eq_ignore_ascii_case(word))
    }

    /// The word in a file.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Const => "const",
            Self::ReadOnly => "ro",
            Self::WriteOnly => "wo",
            Self::ReadWrite => "rw",
            Self::ReadWriteInput => "rwr",
            Self::ReadWriteOutput => "rww",
        }
    }

    /// Returns whether an SDO can read the object.
    #[must_use]
    pub const fn is_readable(self) -> bool {
        !matches!(self, Self::WriteOnly)
    }

    /// Returns whether an SDO can write the object.
    #[must_use]
    pub const fn is_writable(self) -> bool {
        !matches!(self, Self::Const | Self::ReadOnly)
    }
}

impl fmt::Display for AccessType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// Type of an object (CiA 301, 7.4.3, "object code").
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ObjectType {
    /// An object without data.
    Null,
    /// Bytes of any length.
    Domain,
    /// Definition of a simple data type.
    DefType,
    /// Definition of a structure.
    DefStruct,
    /// A single value.
    #[default]
    Var,
    /// Values of the same type.
    Array,
    /// Values of any types.
    Record,
}

impl ObjectType {
    const ALL: [Self; 7] = [
        Self::Null,
        Self::Domain,
        Self::DefType,
        Self::DefStruct,
        Self::Var,
        Self::Array,
        Self::Record,
    ];

    /// The type with this code.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|object_type| object_type.code() == code)
    }

    /// The code in a file and in the object dictionary.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Null => 0,
            Self::Domain => 2,
            Self::DefType => 5,
            Self::DefStruct => 6,
            Self::Var => 7,
            Self::Array => 8,
            Self::Record => 9,
        }
    }

    /// Returns whether objects of this type have sub-objects.
    #[must_use]
    pub const fn has_sub_objects(self) -> bool {
        matches!(self, Self::Array | Self::Record | Self::DefStruct)
    }

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Null => "NULL",
            Self::Domain => "DOMAIN",
            Self::DefType => "DEFTYPE",
            Self::DefStruct => "DEFSTRUCT",
            Self::Var => "VAR",
            Self::Array => "ARRAY",
            Self::Record => "RECORD",
        }
    }
}

impl fmt::Display for ObjectType {
    /// The name of CiA 301, for example `ARRAY`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_and_types_belong_together() {
        for (data_type, index, name, class, size) in TYPES {
            assert_eq!(DataType::from_index(index), data_type);
            assert_eq!(data_type.index(), index);
            assert_eq!(data_type.size().unwrap_or(0), size, "{name}");
            assert_eq!(data_type.is_signed(), class == ValueClass::Signed);
            let is_integer = matches!(class, ValueClass::Signed | ValueClass::Unsigned);
            assert_eq!(data_type.is_integer(), is_integer);
        }
        assert_eq!(DataType::from_index(0x40), DataType::Other(0x40));
        assert_eq!(DataType::Other(0x40).index(), 0x40);
    }

    #[test]
    fn sign_is_extended_from_type_width() {
        assert_eq!(DataType::Integer8.sign_extend(0xFF), -1);
        assert_eq!(DataType::Integer24.sign_extend(0x80_0000), -0x80_0000);
        assert_eq!(DataType::Integer32.sign_extend(0xFFFF_FF9C), -100);
        assert_eq!(DataType::Integer64.sign_extend(u64::MAX), -1);
        assert_eq!(DataType::Unsigned32.sign_extend(0xFFFF_FFFF), 0xFFFF_FFFF);
        assert_eq!(DataType::Integer16.range(), Some((-32768, 32767)));
        assert_eq!(DataType::Unsigned8.range(), Some((0, 255)));
        assert_eq!(DataType::Unsigned64.range(), Some((0, u64::MAX.into())));
        assert_eq!(DataType::Integer64.range(), Some((i64::MIN.into(), i64::MAX.into())));
        assert_eq!(DataType::Integer32.mask((-1i64) as u64), 0xFFFF_FFFF);
    }

    #[test]
    fn boolean_has_one_bit_in_pdo() {
        assert_eq!(DataType::Boolean.pdo_bits(), Some(1));
        assert_eq!(DataType::Unsigned24.pdo_bits(), Some(24));
        assert_eq!(DataType::Domain.pdo_bits(), None);
    }
}
