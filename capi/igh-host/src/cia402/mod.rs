//! CANopen and CiA 402: `igh_cia402_protocol.h`.

pub mod axis;
pub(crate) mod axis_table;
pub mod commands;
pub mod context;
pub mod cycle;
pub mod drive_values;
pub mod numbers;
pub mod sdo;
pub mod state;

#[cfg(all(test, feature = "sim"))]
mod tests;
