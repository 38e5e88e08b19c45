//! Distributed clocks in the cycle: which clock leads, and how far they are apart.

mod distributed_clocks;
mod phase_locked_loop;

pub use distributed_clocks::ClockStatus;
pub(crate) use distributed_clocks::DistributedClocks;
