//! The program `ecan-sim` as a user runs it.

mod misuse;
mod pysoem;
mod raw_master;
pub mod support;
mod variants;
