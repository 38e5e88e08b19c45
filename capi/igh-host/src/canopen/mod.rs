//! CANopen networks: `igh_canopen.h`.

pub mod boot;
mod boot_report;
pub mod boot_terms;
pub(crate) mod lookup;
pub mod lss;
pub mod lss_terms;
pub mod mpdo;
pub mod node;
pub mod node_errors;
pub mod node_sdo;
pub mod services;

#[cfg(all(test, feature = "sim"))]
mod tests;
