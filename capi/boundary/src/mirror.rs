//! Types of C declared together with their conversion from or to a Rust type.

/// Declares a type of C and its conversion in one place. The header generator expands it, too.
///
/// A struct converts from a Rust struct. A field takes the value of the field of the same name; `=`
/// gives another expression. With `set(c) to: Type` a field may also state, after `=>`, how it sets a
/// value of that type: `set_plain` executes all of these.
///
/// An enum `from` a Rust type converts from it by patterns. An enum `as` a Rust type lists its
/// values with their counterparts: `PAIRS`, and `to_rust` for a number that C passes.
///
/// ```
/// # use ecan_c_boundary::mirror;
/// struct Load { share: f64, channel: Option<u8> }
/// mirror! {
///     /// Load of a channel.
///     pub struct load_t from load: Load {
///         /// Share of the bus.
///         share: f64,
///         /// Channel; 255 for none.
///         channel: u8 = load.channel.unwrap_or(255),
///     }
/// }
/// mirror! {
///     /// Direction of a transfer.
///     pub enum direction_t as bool {
///         /// To the host.
///         DIRECTION_IN = 0 => false,
///         /// From the host.
///         DIRECTION_OUT = 1 => true,
///     }
/// }
/// assert_eq!(load_t::from(Load { share: 0.5, channel: None }).channel, 255);
/// assert_eq!(direction_t::to_rust(1), Some(true));
/// ```
#[macro_export]
macro_rules! mirror {
    (
        $(#[$meta:meta])*
        pub struct $name:ident from $from:ident: $rust:ty {
            $($(#[$field_meta:meta])* $field:ident: $ty:ty $(= $value:expr)?),* $(,)?
        }
    ) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug)]
        pub struct $name {
            $($(#[$field_meta])* pub $field: $ty,)*
        }

        impl From<$rust> for $name {
            fn from($from: $rust) -> Self {
                Self { $($field: $crate::mirror!(@value $from $field $($value)?),)* }
            }
        }
    };
    (
        $(#[$meta:meta])*
        pub struct $name:ident from $from:ident: $rust:ty, set($c:ident) $to:ident: $target:ty {
            $(
                $(#[$field_meta:meta])*
                $field:ident: $ty:ty = $value:expr $(=> $set:expr)?
            ),* $(,)?
        }
    ) => {
        $crate::mirror! {
            $(#[$meta])*
            pub struct $name from $from: $rust {
                $($(#[$field_meta])* $field: $ty = $value,)*
            }
        }

        impl $name {
            /// Sets what follows from a field without a check.
            fn set_plain(&self, $to: &mut $target) {
                let $c = self;
                $($($set;)?)*
            }
        }
    };
    (@value $from:ident $field:ident) => { $from.$field.into() };
    (@value $from:ident $field:ident $value:expr) => { $value };
    (
        $(#[$meta:meta])*
        pub enum $name:ident from $rust:ty {
            $($(#[$value_meta:meta])* $value:ident = $number:literal $(=> $pattern:pat)?),* $(,)?
        }
    ) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name {
            $($(#[$value_meta])* $value = $number,)*
        }

        impl From<$rust> for $name {
            fn from(rust: $rust) -> Self {
                match rust {
                    $($($pattern => Self::$value,)?)*
                }
            }
        }
    };
    (
        $(#[$meta:meta])*
        pub enum $name:ident as $rust:ty {
            $($(#[$value_meta:meta])* $value:ident = $number:expr => $counterpart:expr),* $(,)?
        }
    ) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name {
            $($(#[$value_meta])* $value = $number,)*
        }

        impl $name {
            /// Every value with its name and its counterpart.
            pub const PAIRS: &'static [(Self, &'static str, $rust)] =
                &[$((Self::$value, concat!(stringify!($value), "\0"), $counterpart),)*];

            /// Counterpart of a number that C passes.
            pub fn to_rust(number: impl Into<i64>) -> Option<$rust> {
                let number = number.into();
                let pair = Self::PAIRS.iter().find(|(value, ..)| *value as i64 == number)?;
                Some(pair.2)
            }
        }
    };
}
