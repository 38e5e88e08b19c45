//! All tests of the crate in one program; those that need a process of their own are separate.
#![allow(missing_docs)]

mod common;
#[path = "../../ecrt-sys/tests/fake/mod.rs"]
mod fake;

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
