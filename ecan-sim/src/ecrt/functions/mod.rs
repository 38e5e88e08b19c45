//! C interface of the simulated libethercat: the functions and their table.
//!
//! # Safety
//! Handles are never dereferenced (see [`Handle`]). Dereferenced are only out-parameters and
//! buffers of the caller, which are valid or null by the contract of libethercat.
//!
//! A handle looks like a pointer of the real library, but is a number that is never dereferenced
//! and never reused. A stale or unknown pointer is recognised instead of followed.

#[macro_use]
mod boundary;
mod configuration;
mod masters;
mod process_data;
#[cfg(test)]
mod tests;

pub use configuration::*;
pub use masters::*;
pub use process_data::*;
