//! The MCAN Port: `igh_mcan_port.h`.

pub mod config;
pub mod config_file;
pub mod context;
pub mod cycle;
pub mod schedule;
pub mod state;
