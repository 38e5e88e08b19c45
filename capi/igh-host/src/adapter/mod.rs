//! The Adapter: `igh_adapter.h`.

pub mod bus_state;
pub mod config;
pub mod context;
pub mod cycle;
pub mod real_time;
pub mod sdo;
