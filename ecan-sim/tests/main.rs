//! Tests of the simulator.

mod allocation;
#[cfg(feature = "bridge")]
mod bridges;
mod bus;
mod drive;
mod ecrt;
mod ecrt_like_igh;
mod ecrt_pace;
mod ecrt_support;
mod gateway;
mod golden_run;
mod variants;
mod wire;
mod wire_support;
mod world;

use ecan_test_support::CountingAllocator;

// Counts by thread, so that tests beside each other do not disturb.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;
