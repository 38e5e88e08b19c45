//! What tests of several crates need: processes that end with their test, a counting allocator, the engine of random
//! trials, and tshark.

mod allocations;
mod process;
mod seeds;

pub use allocations::{CountingAllocator, allocations};
pub use process::{Killed, Lines, OnDrop, fields_of, output};
pub use seeds::{Sums, catch_panic, run_seeds};
