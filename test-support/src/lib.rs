//! What tests of several crates need: processes that end with their test, a counting allocator, the engine of random
//! trials, and tshark.

mod allocations;
mod process;
mod seeds;
mod tshark;

pub use allocations::{CountingAllocator, allocations};
pub use process::{Killed, Lines, OnDrop, output};
pub use seeds::{Sums, catch_panic, run_seeds};
pub use tshark::fields_of;
