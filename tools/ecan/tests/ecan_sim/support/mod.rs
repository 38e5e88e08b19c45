//! Shared parts of the program's tests.
#![allow(dead_code, missing_docs)]

pub mod image;
pub mod network;
pub mod program;
pub mod raw_master;
pub mod scenario;
