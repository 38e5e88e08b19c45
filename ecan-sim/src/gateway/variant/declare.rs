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

            impl crate::gateway::variant::VariantValue for $type {
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
                use crate::gateway::variant::value::read;
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
