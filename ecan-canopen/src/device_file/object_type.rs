use core::fmt;

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
