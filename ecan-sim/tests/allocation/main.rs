//! Code that must not allocate; a separate binary because of the counting allocator.

mod bus;
mod drive;
mod ecrt;
#[path = "../ecrt_support/mod.rs"]
mod ecrt_support;
mod gateway;
#[path = "../gateway/fixture.rs"]
mod gateway_support;
mod wire;
#[path = "../wire_support/mod.rs"]
mod wire_support;

use ecan_test_support::CountingAllocator;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;
