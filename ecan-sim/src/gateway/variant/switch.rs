//! Types of the switches of [`table`](super::table): their values in scenario files, their descriptions, and the
//! macro that declares them.

use std::ops::RangeInclusive;

use ecan_protocol::object::object;

/// Table of a scenario file that contains a switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VariantTable {
    /// `[gateway.variant]`
    Variant,
    /// `[[gateway]]`
    Gateway,
}

impl VariantTable {
    /// Its header in a scenario file.
    #[must_use]
    pub const fn header(self) -> &'static str {
        match self {
            Self::Variant => "[gateway.variant]",
            Self::Gateway => "[[gateway]]",
        }
    }
}

/// One alternative of a switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Alternative {
    /// Value in TOML.
    pub value: &'static str,
    /// Behaviour of the gateway.
    pub description: &'static str,
}

/// One switch: what the manual leaves open, and the alternatives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Variant {
    /// Key in the scenario file.
    pub key: &'static str,
    /// Table of the key.
    pub table: VariantTable,
    /// Rows of docs/ASSUMPTIONS.md that it switches.
    pub assumptions: &'static [&'static str],
    /// Subject of the switch.
    pub description: &'static str,
    /// The default, then the others. Of a number or list these are samples.
    pub alternatives: &'static [Alternative],
    /// Other permitted values; empty without any.
    pub permitted: &'static str,
}

impl Variant {
    /// The lines of a scenario file that select an alternative in the last gateway.
    #[must_use]
    pub fn toml(&'static self, alternative: &'static Alternative) -> String {
        toml(&[(self, alternative)])
    }
}

/// A switch and one of its alternatives.
pub type Choice = (&'static Variant, &'static Alternative);

/// The lines of a scenario file that select alternatives in the last gateway, after its other keys.
#[must_use]
pub fn toml(choices: &[Choice]) -> String {
    let lines = |table: VariantTable| -> String {
        let of_table = choices.iter().filter(|(variant, _)| variant.table == table);
        of_table.map(|(variant, to)| format!("{} = {}\n", variant.key, to.value)).collect()
    };
    let switches = lines(VariantTable::Variant);
    let header = if switches.is_empty() { "" } else { "[gateway.variant]\n" };
    format!("{}{header}{switches}", lines(VariantTable::Gateway))
}

/// A type that a switch can have.
pub(crate) trait VariantValue: Sized {
    fn read(value: &toml::Value) -> Option<Self>;

    /// The permitted values, for messages.
    fn allowed() -> String;
}

pub(super) fn read<T: VariantValue>(key: &str, value: &toml::Value) -> Result<T, String> {
    T::read(value).ok_or_else(|| {
        format!("`{key}` = {value} is not an alternative; allowed: {}", T::allowed())
    })
}

/// Whole number of a switch, from `MIN` to `MAX`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Number<const MIN: u32, const MAX: u32>(u32);

impl<const MIN: u32, const MAX: u32> Number<MIN, MAX> {
    /// The permitted number nearest to `value`.
    #[must_use]
    pub const fn nearest(value: u32) -> Self {
        Self(if value < MIN {
            MIN
        } else if value > MAX {
            MAX
        } else {
            value
        })
    }

    pub(crate) const fn get(self) -> u32 {
        self.0
    }
}

impl<const MIN: u32, const MAX: u32> VariantValue for Number<MIN, MAX> {
    fn read(value: &toml::Value) -> Option<Self> {
        let number = u32::try_from(value.as_integer()?).ok()?;
        (MIN..=MAX).contains(&number).then_some(Self(number))
    }

    fn allowed() -> String {
        format!("{MIN} to {MAX}")
    }
}

/// Period of a free-running service loop, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServicePeriod(Option<u16>);

impl ServicePeriod {
    /// A service follows each SM2 write.
    pub const AFTER_OUTPUTS: Self = Self(None);

    /// A free-running loop; `None` if the period is not 50 to 1000 us.
    #[must_use]
    pub fn free_running(period_us: u16) -> Option<Self> {
        (50..=1000).contains(&period_us).then_some(Self(Some(period_us)))
    }

    pub(crate) fn ns(self) -> Option<u64> {
        self.0.map(|us| u64::from(us) * 1_000)
    }
}

impl VariantValue for ServicePeriod {
    fn read(value: &toml::Value) -> Option<Self> {
        match u16::try_from(value.as_integer()?).ok()? {
            0 => Some(Self::AFTER_OUTPUTS),
            period_us => Self::free_running(period_us),
        }
    }

    fn allowed() -> String {
        "0 and 50 to 1000".to_owned()
    }
}

/// Entries of the object dictionary that the firmware does not have.
///
/// In a scenario file a list of texts: `"0xF000:26"`, `"0xF000:19..30"`, or `"0x9011"` for all subindices.
/// Subindices are decimal. An index means all objects of its family: 0x8021 those of the four channels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MissingEntries(Vec<(u16, RangeInclusive<u8>)>);

impl MissingEntries {
    /// Reads the form of scenario files. `None` if a text is wrong or names an entry that the dictionary lacks.
    #[must_use]
    pub fn parse<'a>(texts: impl IntoIterator<Item = &'a str>) -> Option<Self> {
        texts.into_iter().map(parse).collect::<Option<_>>().map(Self)
    }

    pub(crate) fn lacks(&self, index: u16, subindex: u8) -> bool {
        self.0.iter().any(|(missing, range)| {
            range.contains(&subindex)
                && object(*missing).is_some_and(|object| object.instance(index).is_some())
        })
    }

    /// True if the firmware lacks every entry of the object.
    pub(crate) fn lacks_object(&self, index: u16) -> bool {
        let entries = object(index).map_or(&[][..], |object| object.entries);
        !entries.is_empty() && entries.iter().all(|entry| self.lacks(index, entry.subindex))
    }
}

fn parse(text: &str) -> Option<(u16, RangeInclusive<u8>)> {
    let (index, subindices) = match text.split_once(':') {
        Some((index, subindices)) => (index, Some(subindices)),
        None => (text, None),
    };
    let index = u16::from_str_radix(index.strip_prefix("0x")?, 16).ok()?;
    let object = object(index)?;
    let Some(subindices) = subindices else { return Some((index, 0..=u8::MAX)) };
    let (first, last) = subindices.split_once("..").unwrap_or((subindices, subindices));
    let range = first.parse().ok()?..=last.parse().ok()?;
    let exists = |subindex: &u8| object.entry(*subindex).is_some();
    (exists(range.start()) && exists(range.end()) && !range.is_empty()).then_some((index, range))
}

impl VariantValue for MissingEntries {
    fn read(value: &toml::Value) -> Option<Self> {
        let texts: Option<Vec<_>> = value.as_array()?.iter().map(toml::Value::as_str).collect();
        Self::parse(texts?)
    }

    fn allowed() -> String {
        "a list of existing entries such as \"0xF000:26\", \"0xF000:19..30\" and \"0x9011\""
            .to_owned()
    }
}

/// Declares the switches of `[gateway.variant]`: an enumeration for each choice, [`GatewayVariant`] with a
/// field for each switch, and the list `VARIANTS`. The first alternative of a choice is its default. A value
/// has samples, the first of which is its default in TOML.
///
/// [`GatewayVariant`]: super::GatewayVariant
macro_rules! variants {
    (
        choices {$(
            $choice:ident: $type:ident, [$($row:literal),+], $subject:literal {
                $default:ident = $default_name:literal, $default_text:literal;
                $( $alternative:ident = $name:literal, $text:literal; )+
            }
        )+}
        values {$(
            $value:ident: $value_type:ty, [$($value_row:literal),+], $value_subject:literal,
            $permitted:literal {
                $default_value:expr => $default_toml:literal, $default_value_text:literal;
                $( $sample_toml:literal, $sample_text:literal; )+
            }
        )*}
    ) => {
        $(
            #[doc = concat!($subject, ".")]
            #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
            pub enum $type {
                #[doc = concat!("`", $default_name, "`: ", $default_text, ".")]
                #[default]
                $default,
                $( #[doc = concat!("`", $name, "`: ", $text, ".")] $alternative, )+
            }

            impl crate::gateway::variant::switch::VariantValue for $type {
                fn read(value: &toml::Value) -> Option<Self> {
                    match value.as_str()? {
                        $default_name => Some(Self::$default),
                        $( $name => Some(Self::$alternative), )+
                        _ => None,
                    }
                }

                fn allowed() -> String {
                    [$default_name, $($name),+].join(", ")
                }
            }
        )+

        /// The switches of one gateway. The default is the assumptions of docs/ASSUMPTIONS.md.
        #[derive(Clone, Debug, PartialEq, Eq)]
        pub struct GatewayVariant {
            $( #[doc = concat!($subject, ".")] pub $choice: $type, )+
            $( #[doc = concat!($value_subject, "; ", $permitted, ".")] pub $value: $value_type, )*
        }

        impl Default for GatewayVariant {
            fn default() -> Self {
                Self {
                    $( $choice: <$type>::default(), )+
                    $( $value: $default_value, )*
                }
            }
        }

        impl GatewayVariant {
            /// Sets a switch by its key.
            ///
            /// # Errors
            /// The text names the permitted keys or values.
            pub(crate) fn set(&mut self, key: &str, value: &toml::Value) -> Result<(), String> {
                use crate::gateway::variant::switch::read;
                match key {
                    $( stringify!($choice) => self.$choice = read(key, value)?, )+
                    $( stringify!($value) => self.$value = read(key, value)?, )*
                    _ => {
                        let keys = [$( stringify!($choice), )+ $( stringify!($value), )*];
                        return Err(format!("unknown variant `{key}`; allowed: {}", keys.join(", ")));
                    }
                }
                Ok(())
            }
        }

        pub(super) const VARIANTS: &[Variant] = &[
            $( Variant {
                key: stringify!($choice),
                table: VariantTable::Variant,
                assumptions: &[$($row),+],
                description: $subject,
                alternatives: &[
                    Alternative {
                        value: concat!("\"", $default_name, "\""),
                        description: $default_text,
                    },
                    $( Alternative { value: concat!("\"", $name, "\""), description: $text }, )+
                ],
                permitted: "",
            }, )+
            $( Variant {
                key: stringify!($value),
                table: VariantTable::Variant,
                assumptions: &[$($value_row),+],
                description: $value_subject,
                alternatives: &[
                    Alternative { value: $default_toml, description: $default_value_text },
                    $( Alternative { value: $sample_toml, description: $sample_text }, )+
                ],
                permitted: $permitted,
            }, )*
        ];
    };
}
pub(super) use variants;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entry_range_and_object_are_read() {
        let missing = MissingEntries::parse(["0xF000:26", "0x8030:2..4", "0x8021"]).unwrap();
        for (index, subindex, expected) in [
            (0xF000, 25, false),
            (0xF000, 26, true),
            (0x8030, 1, false),
            (0x8030, 2, true),
            (0x8030, 4, true),
            (0x8030, 5, false),
            (0x8021, 0, true),
            (0x8024, 20, true),
            (0x8020, 1, false),
        ] {
            assert_eq!(missing.lacks(index, subindex), expected, "{index:#x}:{subindex}");
        }
        assert!(missing.lacks_object(0x8022));
        assert!(!missing.lacks_object(0x8030));
        assert!(!missing.lacks_object(0x1234));
    }

    #[test]
    fn wrong_entries_are_rejected() {
        for text in ["", "F000:1", "0xF000:", "0xF000:33", "0x1234", "0xF000:5..4", "0xF000:1..40"]
        {
            assert_eq!(MissingEntries::parse([text]), None, "{text}");
        }
    }
}
