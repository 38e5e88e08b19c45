//! What tests of several crates need: processes that end with their test, a counting allocator, and tshark.

mod allocations;
mod process;
mod tshark;

pub use allocations::{CountingAllocator, allocations};
pub use process::{Killed, Lines, OnDrop, output};
pub use tshark::fields_of;
