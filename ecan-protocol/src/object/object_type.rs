//! Data types and access rights of the object dictionary.

/// CoE data type of an object dictionary entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ObjectType {
    /// Unsigned, 8 bit.
    U8,
    /// Unsigned, 16 bit.
    U16,
    /// Unsigned, 32 bit.
    U32,
    /// Signed, 32 bit. Values in the dictionary and in [`SdoWrite`](super::SdoWrite) are its two's
    /// complement.
    I32,
    /// Text whose length the device decides.
    VisibleString,
    /// STRING(16): one 16-byte unit of a PDO image (manual 5.1).
    String16,
}

impl ObjectType {
    /// Bytes of a value in an SDO transfer; `None` if the device decides.
    pub const fn size_bytes(self) -> Option<usize> {
        match self {
            Self::U8 => Some(1),
            Self::U16 => Some(2),
            Self::U32 | Self::I32 => Some(4),
            Self::VisibleString => None,
            Self::String16 => Some(16),
        }
    }

    /// Name in the tables of the manual (13).
    pub const fn name(self) -> &'static str {
        match self {
            Self::U8 => "U8",
            Self::U16 => "U16",
            Self::U32 => "U32",
            Self::I32 => "I32",
            Self::VisibleString => "STRING",
            Self::String16 => "STRING(16)",
        }
    }

    /// True for the types whose values fit into a `u32`.
    pub const fn is_integer(self) -> bool {
        !matches!(self, Self::VisibleString | Self::String16)
    }

    /// Largest raw value of an integer type, 0 for a string type.
    pub const fn max_value(self) -> u32 {
        match self {
            Self::U8 => 0xFF,
            Self::U16 => 0xFFFF,
            Self::U32 | Self::I32 => u32::MAX,
            Self::VisibleString | Self::String16 => 0,
        }
    }
}

/// SDO access to an entry (manual 3.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Access {
    /// Read only.
    Ro,
    /// Read and write.
    Rw,
    /// Write only: a command; its read value has no meaning.
    Wo,
}

impl Access {
    /// True if an SDO upload is allowed.
    pub const fn can_read(self) -> bool {
        matches!(self, Self::Ro | Self::Rw)
    }

    /// True if an SDO download is allowed.
    pub const fn can_write(self) -> bool {
        matches!(self, Self::Rw | Self::Wo)
    }
}
