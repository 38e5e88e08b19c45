//! Session of a gateway: startup steps, verification after each return to OP.

mod check_runner;
mod controller_reading;
pub(crate) mod machine;
pub(crate) mod pending_step;
mod profile_restore;
mod startup;
mod startup_retry;
pub(crate) mod verification;
