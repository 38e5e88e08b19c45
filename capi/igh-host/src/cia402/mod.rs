//! CANopen and CiA 402: `igh_cia402_protocol.h`.

pub mod axis;
mod axis_table;
pub mod canopen;
pub mod commands;
pub mod context;
pub mod cycle;
pub mod host_loss;
pub mod numbers;
pub mod plan;
pub mod progress;
pub mod sdo;
pub mod settings;
pub mod start_up;
pub mod state;
pub mod state_terms;
pub mod statistics;
pub mod targets;

#[cfg(all(test, feature = "sim"))]
mod tests;
