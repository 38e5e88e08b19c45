//! CANopen and CiA 402: `igh_cia402_protocol.h`.

pub mod axis;
mod axis_options;
mod axis_table;
pub mod canopen;
pub mod commands;
pub mod context;
pub mod cycle;
pub mod drive_values;
pub mod host_loss;
pub mod numbers;
pub mod plan;
pub mod process_data;
pub mod progress;
pub mod sdo;
pub mod settings;
pub mod start_up;
pub mod state;
pub mod state_terms;
pub mod statistics;
pub mod targets;
pub mod touch_probe;

#[cfg(all(test, feature = "sim"))]
mod tests;
