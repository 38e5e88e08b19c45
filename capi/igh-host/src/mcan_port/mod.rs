//! The MCAN Port: `igh_mcan_port.h`.

pub mod config;
pub mod config_channel;
pub mod config_file;
pub mod config_filter;
pub mod config_gateway;
pub mod context;
pub mod cycle;
pub mod schedule;
pub mod send;
pub mod service;
pub mod state;
pub mod statistics;
