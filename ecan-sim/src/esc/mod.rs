//! EtherCAT front end: a slave controller (ESC, ETG.1000.4) before each gateway, driven by Ethernet
//! frames. It drives the same firmware as the simulated libethercat, [`crate::gateway`].

mod buffers;
mod clock;
mod controller;
mod eeprom;
mod frame;
mod registers;
mod sync_manager;
mod wire;

use crate::gateway::Gateway;

pub use frame::ETHERCAT_ETHERTYPE;
pub use wire::{Wire, WireStatistics};

/// Context of a frame in one slave controller.
struct Context<'a> {
    gateway: &'a mut Gateway,
    now: u64,
    /// Time of the frame from the first slave to this one, ns.
    delay_ns: u64,
    /// Time until the frame returns from the next slave; `None` without one.
    return_ns: Option<u64>,
}
