//! Tests of the formats and protocols.
#![allow(missing_docs, clippy::disallowed_macros, clippy::disallowed_methods)]

mod bridge;
mod candump;
mod capture;
mod dbc;
mod recording;

#[global_allocator]
static ALLOCATOR: ecan_test_support::CountingAllocator = ecan_test_support::CountingAllocator;
