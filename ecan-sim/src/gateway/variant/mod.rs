//! Variants: points that the manual leaves open, as switches of a simulated gateway.
//!
//! `table` declares each switch of `[gateway.variant]` once; the structure [`GatewayVariant`], its enumerations,
//! the keys of scenario files and the list [`variants`] follow from it. The default of each switch is the
//! assumption of docs/ASSUMPTIONS.md. The behaviour is in the module of its subject, which asks the variant of
//! its gateway.

mod switch;
mod table;

pub use switch::{
    Alternative, Choice, MissingEntries, Number, ServicePeriod, Variant, VariantTable, toml,
};
pub use table::*;
