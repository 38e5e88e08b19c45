//! Tests of the CiA 402 drive.

mod eds;
pub mod fixture;
mod guarding;
mod host_loss;
mod lss;
mod motion;
mod network;
mod pdo;
mod properties;
mod scenario;
mod sdo_server;
mod several_axes;
mod state_machine;
mod trace;
