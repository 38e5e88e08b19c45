//! Context of an access to a slave controller.

use crate::gateway::Gateway;

/// Context of a frame in one slave controller.
pub(super) struct Context<'a> {
    pub(super) gateway: &'a mut Gateway,
    /// Simulated time, ns.
    pub(super) now: u64,
    /// Time of the frame from the first slave to this one, ns.
    pub(super) delay_ns: u64,
    /// Time until the frame returns from the next slave; `None` without one.
    pub(super) return_ns: Option<u64>,
}
