//! The EtherCAT front: a slave controller (ESC) before each gateway, driven by Ethernet frames.
//!
//! It is what a master on a wire sees: registers, station addresses, FMMUs, sync managers, the
//! SII EEPROM, distributed clocks and mailboxes, as ETG.1000.4 describes them. What the gateway
//! behind them does is [`crate::gateway`]'s; this front and the simulated libethercat drive the
//! same firmware.

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
