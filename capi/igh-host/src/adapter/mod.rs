//! The Adapter: `igh_adapter.h`.

pub mod bus_state;
pub mod clocks;
pub mod config;
pub mod config_clocks;
pub mod config_master;
pub mod config_slave;
pub mod context;
pub mod cycle;
pub mod diagnostics;
mod library;
pub mod process_data;
pub mod real_time;
pub mod sdo;
pub mod sdo_request;
pub mod simulation;
