//! The examples as a user runs them.

mod canopen_network;
#[path = "../../ecan-mcan-port/tests/common/mod.rs"]
mod common;
mod dc_clocks;
mod mcan_gateway_tx_probe;
mod motion_demos;
mod phase_sweep;
mod plan;
mod program;
mod simple_loop;
mod stable_points;
