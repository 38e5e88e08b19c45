//! Enumerations with the numbers that the device uses for them.

/// Defines a fieldless enumeration with `from_raw` and `raw`.
macro_rules! raw_enum {
    (
        $(#[$meta:meta])*
        $vis:vis enum $name:ident: $raw:ty {
            $( $(#[$variant_meta:meta])* $variant:ident = $value:literal, )+
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        $vis enum $name {
            $( $(#[$variant_meta])* $variant = $value, )+
        }

        impl $name {
            /// The variant for the number that the device uses, `None` for an unknown number.
            pub const fn from_raw(raw: $raw) -> Option<Self> {
                match raw {
                    $( $value => Some(Self::$variant), )+
                    _ => None,
                }
            }

            /// The number that the device uses.
            pub const fn raw(self) -> $raw {
                self as $raw
            }
        }
    };
}

pub(crate) use raw_enum;
