//! Shared parts of the program's tests.
#![allow(dead_code, missing_docs)]

#[path = "../../../../ecan-sim/tests/ethercrab_support/bring_up.rs"]
pub mod bring_up;
pub mod image;
pub mod network;
pub mod program;
pub mod raw_master;
pub mod scenario;
