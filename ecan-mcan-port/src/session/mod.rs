//! Session of a gateway: startup steps, verification after each return to OP.

mod check_runner;
pub(crate) mod machine;
mod startup;
pub(crate) mod verification;
