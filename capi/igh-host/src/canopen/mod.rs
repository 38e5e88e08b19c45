//! CANopen networks: `igh_canopen.h`.

pub mod boot;
pub mod lss;
pub mod node;
pub mod services;

#[cfg(all(test, feature = "sim"))]
mod tests;
