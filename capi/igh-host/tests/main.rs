//! Tests of the C functions as an application calls them.

#[cfg(feature = "sim")]
mod allocation;
#[cfg(feature = "sim")]
mod c_port;
mod corrupted_config;
#[cfg(feature = "sim")]
mod every_function;
#[cfg(feature = "sim")]
mod node_allocation;
#[cfg(not(feature = "sim"))]
mod without_simulator;

#[global_allocator]
static ALLOCATOR: ecan_test_support::CountingAllocator = ecan_test_support::CountingAllocator;
