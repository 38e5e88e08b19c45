//! EtherCAT front end: a slave controller (ESC) before each gateway, driven by Ethernet frames.
//!
//! It has what a master on a wire sees: registers, station addresses, FMMUs, sync managers, the SII
//! EEPROM, distributed clocks and mailboxes, as specified in ETG.1000.4. This front end and the
//! simulated libethercat drive the same firmware, [`crate::gateway`].

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
