//! Code that must not allocate; a separate binary because of the counting allocator.

mod bus;
#[path = "../counting/mod.rs"]
mod counting;
mod drive;
#[path = "../ecrt_support/mod.rs"]
mod ecrt_support;
