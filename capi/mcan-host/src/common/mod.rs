//! What all C headers share: `igh_ecan_common.h`.

pub mod constants;
pub mod last_error;
pub mod result;
pub mod version;
