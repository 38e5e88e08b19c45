//! Tests of the Adapter.
#![allow(missing_docs)]

mod common;
#[path = "../../ecrt-sys/tests/fake/mod.rs"]
mod fake;

mod bring_up;
mod cycle_allocation;
mod cycle_statistics;
mod cycle_timer;
mod distributed_clocks;
mod master;
mod observer;
mod opening;
mod operation;
mod plan;
mod real_time_settings;
mod slave_access;

use ecan_test_support::CountingAllocator;

// Counts by thread, so that tests beside each other do not disturb.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;
