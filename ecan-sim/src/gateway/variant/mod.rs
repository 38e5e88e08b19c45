//! Variants: points that the manual leaves open, as switches of a simulated gateway.
//!
//! `table` declares each switch of `[gateway.variant]` once; the structure [`GatewayVariant`], its enumerations,
//! the keys of scenario files and the list [`variants`] follow from it. The default of each switch is the
//! assumption of docs/ASSUMPTIONS.md. The behaviour is in the module of its subject, which asks the variant of
//! its gateway.

mod declare;
mod gateway_keys;
mod missing_entries;
mod number;
mod service_period;
mod table;
mod value;

pub use missing_entries::MissingEntries;
pub use number::Number;
pub use service_period::ServicePeriod;
pub use table::*;
pub(crate) use value::VariantValue;

impl MappedSubindex {
    pub(crate) const fn number(self) -> u8 {
        match self {
            Self::One => ecan_protocol::object::MAPPED_SUBINDEX,
            Self::Zero => 0,
        }
    }
}

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

/// Every switch: those of `[gateway.variant]`, then those of `[[gateway]]`.
pub fn variants() -> impl Iterator<Item = &'static Variant> {
    table::VARIANTS.iter().chain(gateway_keys::GATEWAY_KEYS)
}
