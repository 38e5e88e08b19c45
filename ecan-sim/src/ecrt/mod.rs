//! Front end `ecrt`: a simulated libethercat with the function table of the real one.
//!
//! Behaves as IgH EtherCAT master 1.6.2 (or 1.5.2) does towards an application. The kernel module
//! and the user space library are one here.

mod clocks;
mod domain;
mod shared;
// the crate root documents the safety contract of all functions, `ecrt_sys::Functions` each of them
#[allow(missing_docs, clippy::missing_safety_doc)]
pub(crate) mod functions;
mod master;
mod sdo_transfer;
mod slaves;
mod timing;

pub(crate) use functions::simulated_library;
pub(crate) use shared::Shared;
