//! Shared part of all C headers: `igh_ecan_common.h`.

pub mod last_error;
pub mod result;
pub mod version;
