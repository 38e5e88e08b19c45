//! Timeouts of the programs that send plain CAN frames.

/// Time without a frame after which none is pending, ns.
pub const IDLE_TIMEOUT_NS: u64 = 200_000_000;
/// Time without an accepted or received frame after which a program ends, ns.
pub const STALL_TIMEOUT_NS: u64 = 10_000_000_000;
