//! The types that an object's values have, and enumerations with the numbers of the manual.

/// Form of the value of an [`Entry`](super::Entry) in a configuration file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyForm {
    /// As a whole number.
    Number,
    /// As `true` or `false`.
    Flag,
    /// As one word: the text of the value in lower case, with underscores.
    Word,
    /// As a list of words, in lower case; each stands for the given bits.
    Words(&'static [(&'static str, u32)]),
    /// As a list of words: the texts of the set bits, in lower case.
    Bits,
    /// As one of these sizes; its position in the list is the raw value.
    Size(&'static [u32]),
    /// As a percentage, or as the first one of a list of two.
    LowerBound,
    /// As a percentage, or as the second one of a list of two.
    UpperBound,
}

/// A type of a configuration field: how its values are written to an object.
pub(crate) trait ObjectValue: Copy + 'static {
    const TYPE: ObjectType;
    /// Largest raw value.
    const MAX: u32 = Self::TYPE.max_value();
    /// Meaning of single values; complete, or empty.
    const VALUES: &'static [(u32, &'static str)] = &[];
    /// Meaning of single bits; complete, or empty.
    const BITS: &'static [(u8, &'static str)] = &[];
    /// Form of the value in a configuration file.
    const FORM: KeyForm = KeyForm::Number;

    fn to_raw(self) -> u32;

    fn try_from_raw(raw: u32) -> Option<Self>;
}

impl ObjectValue for bool {
    const TYPE: ObjectType = ObjectType::U8;
    const MAX: u32 = 1;
    const FORM: KeyForm = KeyForm::Flag;

    fn to_raw(self) -> u32 {
        self.into()
    }

    fn try_from_raw(raw: u32) -> Option<Self> {
        (raw <= 1).then_some(raw == 1)
    }
}

macro_rules! numbers {
    ($($number:ty = $TYPE:ident,)+) => {$(
        impl ObjectValue for $number {
            const TYPE: ObjectType = ObjectType::$TYPE;

            fn to_raw(self) -> u32 {
                self.into()
            }

            fn try_from_raw(raw: u32) -> Option<Self> {
                raw.try_into().ok()
            }
        }
    )+};
}

numbers! { u8 = U8, u16 = U16, u32 = U32, }

/// The raw value of a default, in a constant.
macro_rules! raw_default {
    (bool, $value:expr) => {
        $value as u32
    };
    (u8, $value:expr) => {
        $value as u32
    };
    (u16, $value:expr) => {
        $value as u32
    };
    (u32, $value:expr) => {
        $value
    };
    ($ty:ident, $value:expr) => {
        $value.raw() as u32
    };
}

/// The largest of the listed values.
pub(crate) const fn largest(values: &[(u32, &str)]) -> u32 {
    let mut largest = 0;
    let mut rest = values;
    while let [(value, _), tail @ ..] = rest {
        if *value > largest {
            largest = *value;
        }
        rest = tail;
    }
    largest
}

/// Defines an enumeration with the numbers and texts of the manual: `from_raw`, `raw`, `Display`,
/// and its use as the value of an object.
///
/// A number after `|` is another one that the device accepts for the variant. The form is that of
/// the value in a configuration file; a word if none is given.
macro_rules! raw_enum {
    (@form) => { $crate::object::KeyForm::Word };
    (@form $form:expr) => { $form };
    (
        $(#[$meta:meta])*
        $vis:vis enum $name:ident: $raw:ident $(, $form:expr)? ;
        $( $(#[$variant_meta:meta])* $variant:ident = $value:literal $(| $also:literal)?, $text:literal; )+
    ) => {
        $crate::text_enum! {
            $(#[$meta])*
            #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
            $vis enum $name: $raw;
            $( $(#[$variant_meta])* $variant = $value, $text; )+
        }
        impl $crate::object::ObjectValue for $name {
            const TYPE: $crate::object::ObjectType =
                <$raw as $crate::object::ObjectValue>::TYPE;
            const MAX: u32 = $crate::object::largest(Self::VALUES);
            const VALUES: &'static [(u32, &'static str)] =
                &[$( ($value, $text), $( ($also, $text), )? )+];
            const FORM: $crate::object::KeyForm =
                $crate::object::raw_enum!(@form $( $form )?);

            fn to_raw(self) -> u32 {
                self.raw().into()
            }

            fn try_from_raw(raw: u32) -> Option<Self> {
                match raw {
                    $( $value $( | $also )? => Some(Self::$variant), )+
                    _ => None,
                }
            }
        }
    };
}

/// Defines an enumeration of statuses that a firmware may extend: `from_raw`, `raw`, and `Display`
/// with number and text. Numbers that the manual does not list are `Unknown`.
macro_rules! status_enum {
    (
        $(#[$meta:meta])*
        $vis:vis enum $name:ident;
        $( $(#[$variant_meta:meta])* $variant:ident = $value:literal, $text:literal; )+
    ) => {
        $crate::open_enum! {
            $(#[$meta])*
            $vis enum $name: u8 else Unknown;
            $( $(#[$variant_meta])* #[doc = concat!("\n`", $text, "`")] $variant = $value; )+
        }

        impl $name {
            #[allow(dead_code, reason = "not every status has a row of the dictionary")]
            pub(crate) const VALUES: &'static [(u32, &'static str)] = &[$( ($value, $text), )+];
        }

        impl core::fmt::Display for $name {
            /// Number and text: `2 (denied)`.
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                let text = match self {
                    $( Self::$variant => $text, )+
                    Self::Unknown(_) => "not in the manual",
                };
                write!(f, "{} ({text})", self.raw())
            }
        }
    };
}

/// Defines a set of flags as the value of an object: a constant for each bit, with the manual's
/// text.
macro_rules! raw_flags {
    (
        $name:ident: $raw:ident;
        $( $(#[$flag_meta:meta])* $flag:ident = $bit:literal, $text:literal; )+
    ) => {
        impl $name {
            $( $(#[$flag_meta])* pub const $flag: Self = Self(1 << $bit); )+
            /// All flags of the manual.
            pub const ALL: Self = Self($( 1 << $bit )|+);

            const NAMES: &'static [(&'static str, u32)] = &[$( (stringify!($flag), 1 << $bit), )+];

            const fn raw(self) -> $raw {
                self.0
            }
        }

        impl $crate::object::ObjectValue for $name {
            const TYPE: $crate::object::ObjectType =
                <$raw as $crate::object::ObjectValue>::TYPE;
            const MAX: u32 = Self::ALL.0 as u32;
            const BITS: &'static [(u8, &'static str)] = &[$( ($bit, $text), )+];
            const FORM: $crate::object::KeyForm = $crate::object::KeyForm::Words(Self::NAMES);

            fn to_raw(self) -> u32 {
                self.0.into()
            }

            fn try_from_raw(raw: u32) -> Option<Self> {
                if raw & !Self::MAX == 0 { raw.try_into().ok().map(Self) } else { None }
            }
        }
    };
}

pub(crate) use {raw_default, raw_enum, raw_flags, status_enum};

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
