//! Enumerations that have a text per variant, and the numbers of the manual or of a standard.

/// Declares an enumeration with `Display`; with a number type also `ALL`, `from_raw` and `raw`. The
/// text ends the documentation of its variant.
///
/// ```
/// ecan_protocol::text_enum! {
///     /// State of a valve.
///     pub enum Valve: u8;
///     /// Nothing passes.
///     Closed = 0, "closed";
///     /// Everything passes.
///     Open = 4, "fully open";
/// }
/// assert_eq!(Valve::from_raw(4), Some(Valve::Open));
/// assert_eq!((Valve::Closed.raw(), Valve::Open.to_string()), (0, "fully open".into()));
/// ```
///
/// Without the number type and the numbers only `Display` is declared.
#[macro_export]
macro_rules! text_enum {
    (
        $(#[$meta:meta])*
        $vis:vis enum $name:ident;
        $( $(#[$variant_meta:meta])* $variant:ident = $text:literal; )+
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        $vis enum $name {
            $( $(#[$variant_meta])* #[doc = concat!("\n`", $text, "`")] $variant, )+
        }
        $crate::text_enum!(@display $name { $( $variant, $text; )+ });
    };
    (
        $(#[$meta:meta])*
        $vis:vis enum $name:ident: $raw:ident;
        $( $(#[$variant_meta:meta])* $variant:ident = $value:literal, $text:literal; )+
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        $vis enum $name {
            $( $(#[$variant_meta])* #[doc = concat!("\n`", $text, "`")] $variant = $value, )+
        }
        impl $name {
            /// All variants.
            pub const ALL: &'static [Self] = &[$( Self::$variant, )+];

            /// Returns the variant with this number, `None` if no variant has it.
            pub const fn from_raw(raw: $raw) -> Option<Self> {
                match raw {
                    $( $value => Some(Self::$variant), )+
                    _ => None,
                }
            }

            /// The number.
            pub const fn raw(self) -> $raw {
                self as $raw
            }
        }
        $crate::text_enum!(@display $name { $( $variant, $text; )+ });
    };
    (@display $name:ident { $( $variant:ident, $text:literal; )+ }) => {
        impl core::fmt::Display for $name {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                f.write_str(match self {
                    $( Self::$variant => $text, )+
                })
            }
        }
    };
}

/// Declares an enumeration that keeps every other number in the variant after `else`: `from_raw` and
/// `raw`, and with texts `Display`, where the text of that variant is the noun before the number.
///
/// ```
/// ecan_protocol::open_enum! {
///     /// Colour of a lamp.
///     pub enum Colour: u8 else Other, "colour";
///     /// Red.
///     Red = 0, "red";
/// }
/// assert_eq!(Colour::from_raw(7), Colour::Other(7));
/// assert_eq!(Colour::from_raw(7).to_string(), "colour 7");
/// ```
#[macro_export]
macro_rules! open_enum {
    (
        $(#[$meta:meta])*
        $vis:vis enum $name:ident: $raw:ident else $other:ident;
        $( $(#[$variant_meta:meta])* $variant:ident = $value:literal; )+
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        $vis enum $name {
            $( $(#[$variant_meta])* $variant, )+
            /// A number without a variant of its own.
            $other($raw),
        }
        impl $name {
            /// Returns the variant with this number.
            #[inline]
            pub const fn from_raw(raw: $raw) -> Self {
                match raw {
                    $( $value => Self::$variant, )+
                    other => Self::$other(other),
                }
            }

            /// The number.
            #[inline]
            pub const fn raw(self) -> $raw {
                match self {
                    $( Self::$variant => $value, )+
                    Self::$other(raw) => raw,
                }
            }
        }
    };
    (
        $(#[$meta:meta])*
        $vis:vis enum $name:ident: $raw:ident else $other:ident, $noun:literal;
        $( $(#[$variant_meta:meta])* $variant:ident = $value:literal, $text:literal; )+
    ) => {
        $crate::open_enum! {
            $(#[$meta])*
            $vis enum $name: $raw else $other;
            $( $(#[$variant_meta])* #[doc = concat!("\n`", $text, "`")] $variant = $value; )+
        }
        impl core::fmt::Display for $name {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                match self {
                    $( Self::$variant => f.write_str($text), )+
                    Self::$other(raw) => write!(f, "{} {raw}", $noun),
                }
            }
        }
    };
}
