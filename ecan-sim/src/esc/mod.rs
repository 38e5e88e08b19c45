//! EtherCAT front end: a slave controller (ESC, ETG.1000.4) before each gateway, driven by Ethernet
//! frames. It drives the same firmware as the simulated libethercat, [`crate::gateway`].

mod clock;
mod command;
mod context;
mod controller;
mod eeprom;
mod fmmu;
mod frame;
mod sii;
mod sync_manager;
mod wire;

pub use frame::ETHERCAT_ETHERTYPE;
pub use wire::{Wire, WireStatistics};
