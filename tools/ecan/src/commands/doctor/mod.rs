//! `ecan doctor`: problems of the host and their remedies.
//!
//! Each check of files is a function that reads below a root directory.

mod check;
mod command;
mod gateways;
mod host;
mod master;

pub use check::{Check, Root};
pub use command::{DoctorArguments, host_checks, run};
