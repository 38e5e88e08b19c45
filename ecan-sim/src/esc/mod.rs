//! EtherCAT front end: a slave controller (ESC, ETG.1000.4) before each gateway, driven by Ethernet
//! frames. It drives the same firmware as the simulated libethercat, [`crate::gateway`].

mod controller;
mod eeprom;
mod frame;
mod registers;
mod sync_manager;

pub use controller::{Wire, WireStatistics};
pub use frame::ETHERCAT_ETHERTYPE;

use crate::gateway::Gateway;

/// Context of a frame in one slave controller.
struct Context<'a> {
    gateway: &'a mut Gateway,
    now: u64,
    /// Time of the frame from the first slave to this one, ns.
    delay_ns: u64,
    /// Time until the frame returns from the next slave; `None` without one.
    return_ns: Option<u64>,
}
