//! The declaration of a configuration object, its SDO downloads, and what every such configuration can do.

use super::entry::{Entry, Object};
use super::value::ObjectType;

/// A configuration that is written to an object of the dictionary, field by field.
///
/// The fields are the entries of the object that [`value`](Self::value) has a value for.
pub trait ConfigObject: Copy + Default {
    /// Index of the object, or of the first object of a family.
    const INDEX: u16;
    /// Entries of the object in ascending order of subindex, those that are no fields included.
    const ENTRIES: &'static [Entry];

    /// Raw value of a field, `None` if the subindex is not a field.
    fn value(&self, subindex: u8) -> Option<u32>;

    /// Sets a field from its raw value, as a device or a project file states it.
    ///
    /// Ranges are not checked.
    ///
    /// # Errors
    /// [`InvalidValue`] if the subindex is not a field, or if its type or enumeration has no such
    /// value; the configuration is unchanged.
    fn set_value(&mut self, subindex: u8, value: u32) -> Result<(), InvalidValue>;

    /// The fields, in ascending order of subindex.
    fn fields() -> impl Iterator<Item = &'static Entry> {
        let any = Self::default();
        Self::ENTRIES.iter().filter(move |entry| any.value(entry.subindex).is_some())
    }

    /// Creates a configuration from raw values; `read` returns the value of a subindex.
    ///
    /// # Errors
    /// [`InvalidValue`] for the first field that cannot have its value.
    fn from_values(mut read: impl FnMut(u8) -> u32) -> Result<Self, InvalidValue> {
        let mut config = Self::default();
        for entry in Self::fields() {
            config.set_value(entry.subindex, read(entry.subindex))?;
        }
        Ok(config)
    }

    /// The downloads of all fields to the object `index`, in ascending order of subindex.
    fn writes_to(&self, index: u16) -> impl Iterator<Item = SdoWrite> + use<Self> {
        let config = *self;
        Self::ENTRIES.iter().filter_map(move |entry| {
            let value = config.value(entry.subindex)?;
            Some(SdoWrite::new(index, entry.subindex, entry.ty, value))
        })
    }

    /// True if the entry has an effect: all entries that it needs are set.
    fn has_effect(&self, entry: &Entry) -> bool {
        entry.needs.iter().all(|&needed| self.value(needed) != Some(0))
    }

    /// Reports every field outside the range of its entry.
    fn check_ranges(&self, report: &mut dyn FnMut(RangeFault)) {
        for &Entry { subindex, min, max, .. } in Self::ENTRIES {
            if let Some(value) = self.value(subindex)
                && !(min..=max).contains(&value)
            {
                report(RangeFault { index: Self::INDEX, subindex, value, min, max });
            }
        }
    }
}

/// A value that a field of a configuration object cannot have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InvalidValue {
    /// Index of the object, or of the first object of a family.
    pub index: u16,
    /// Subindex of the field.
    pub subindex: u8,
    /// The value.
    pub value: u32,
}

/// A field outside the range of its entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RangeFault {
    /// Index of the object, or of the first object of a family.
    pub index: u16,
    /// Subindex of the field.
    pub subindex: u8,
    /// Value of the field.
    pub value: u32,
    /// Smallest allowed value.
    pub min: u32,
    /// Largest allowed value.
    pub max: u32,
}

impl core::error::Error for InvalidValue {}

impl core::error::Error for RangeFault {}

/// Declares a configuration object once: from it follow the struct, its `DEVICE_DEFAULT`, its
/// [`ConfigObject`] implementation and the rows of the object dictionary.
///
/// ```text
/// object! {
///     /// Doc comment of the struct.
///     pub struct ExampleConfig {
///         /// A field whose parts are rows of their own, with its default.
///         window: SamplePointWindow = SamplePointWindow::DEFAULT,
///     }
///     const EXAMPLE = Object::single(0x8040, "Example", "13.9", ExampleConfig::ENTRIES);
///     entries {
///         entry(Entry::highest(5));                       // an entry that is not configured
///         /// Doc comment of the field.
///         3 "Mode" mode: ExampleMode = ExampleMode::Off;  // subindex, name, field, type, default
///         4 "Delay us" delay_us: u16 = 10, range(1, 1000), unit("us"), needs(&[3]);
///         part 5 "Window min" window.min: u16, key("window_min");
///     }
/// }
/// ```
///
/// Type, range and texts follow from the Rust type (see [`ObjectValue`](super::ObjectValue));
/// calls after the default are those of [`Entry`]. The key in configuration files is the name of
/// the field unless `key` or `no_key` changes it.
macro_rules! object {
    (
        $(#[$meta:meta])*
        pub struct $Config:ident {
            $( $(#[$part_meta:meta])* $part:ident: $Part:ty = $part_default:expr, )*
        }
        $( const $OBJECT:ident = $object:expr; )+
        entries {$(
            $( entry($entry:expr) )?
            $(
                part $part_subindex:literal $part_name:literal $($path:ident).+: $part_ty:ident
                $(, $part_call:ident($($part_argument:expr),*) )*
            )?
            $(
                $(#[$field_meta:meta])*
                $subindex:literal $name:literal $field:ident: $ty:ident = $default:expr
                $(, $call:ident($($argument:expr),*) )*
            )?
        ;)+}
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        pub struct $Config {
            $($( $(#[$field_meta])* pub $field: $ty, )?)+
            $( $(#[$part_meta])* pub $part: $Part, )*
        }

        impl $Config {
            /// Values of the device after a factory reset.
            pub const DEVICE_DEFAULT: Self = Self {
                $($( $field: $default, )?)+
                $( $part: $part_default, )*
            };

            const ENTRIES: &'static [Entry] = &[$(
                $( $entry, )?
                $(
                    Entry::field::<$part_ty>($part_subindex, $part_name)
                        .default($crate::object::raw_default!(
                            $part_ty, Self::DEVICE_DEFAULT.$($path).+
                        ))
                        $( .$part_call($($part_argument),*) )*,
                )?
                $(
                    Entry::field::<$ty>($subindex, $name)
                        .default($crate::object::raw_default!($ty, Self::DEVICE_DEFAULT.$field))
                        .key(stringify!($field))
                        $( .$call($($argument),*) )*,
                )?
            )+];
        }

        impl Default for $Config {
            fn default() -> Self {
                Self::DEVICE_DEFAULT
            }
        }

        $( pub(crate) const $OBJECT: Object = $object; )+

        impl $crate::object::ConfigObject for $Config {
            const INDEX: u16 = [$( $OBJECT.first ),+][0];
            const ENTRIES: &'static [Entry] = Self::ENTRIES;

            fn value(&self, subindex: u8) -> Option<u32> {
                use $crate::object::ObjectValue;
                Some(match subindex {
                    $(
                        $( $part_subindex => self.$($path).+.to_raw(), )?
                        $( $subindex => self.$field.to_raw(), )?
                    )+
                    _ => return None,
                })
            }

            #[allow(clippy::useless_conversion, reason = "some fields are wider than their entry")]
            fn set_value(
                &mut self,
                subindex: u8,
                value: u32,
            ) -> Result<(), $crate::object::InvalidValue> {
                use $crate::object::ObjectValue;
                let index = Self::INDEX;
                let invalid = $crate::object::InvalidValue { index, subindex, value };
                match subindex {
                    $(
                        $( $part_subindex => {
                            self.$($path).+ =
                                <$part_ty>::try_from_raw(value).ok_or(invalid)?.into();
                        } )?
                        $( $subindex => {
                            self.$field = <$ty>::try_from_raw(value).ok_or(invalid)?;
                        } )?
                    )+
                    _ => return Err(invalid),
                }
                Ok(())
            }
        }
    };
}

/// One SDO download.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SdoWrite {
    /// Object index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
    /// The value; of a signed type its two's complement.
    pub value: u32,
    /// Type of the value, which sets the number of bytes.
    pub ty: ObjectType,
}

/// 0 as U8 to 0x0000:00: the filler of an empty list, never sent.
impl Default for SdoWrite {
    fn default() -> Self {
        Self::new(0, 0, ObjectType::U8, 0)
    }
}

impl SdoWrite {
    /// Creates a download of `value` as `ty`.
    pub const fn new(index: u16, subindex: u8, ty: ObjectType, value: u32) -> Self {
        Self { index, subindex, value, ty }
    }

    /// The download that applies what was written to a member of an object family: 1 to its apply
    /// command.
    pub(crate) const fn apply(object: &Object, instance: u8) -> Self {
        let command = match object.apply {
            Some(apply) => apply.command,
            None => 0,
        };
        Self::new(object.first + instance as u16 * object.stride, command, ObjectType::U8, 1)
    }

    /// Returns the value as it is sent, little-endian, and the number of valid bytes.
    pub const fn bytes(&self) -> ([u8; 4], usize) {
        let size = match self.ty {
            ObjectType::U8 => 1,
            ObjectType::U16 => 2,
            _ => 4,
        };
        (self.value.to_le_bytes(), size)
    }
}

pub(crate) use object;
