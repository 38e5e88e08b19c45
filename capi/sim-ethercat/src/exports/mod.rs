//! The functions under libethercat's names.
//!
//! Each passes its arguments to the simulator's function, which catches panics. The arguments are
//! those of IgH's interface, with the same contract.

mod functions;
mod opening;
mod other_mailbox_protocols;
mod simulated;
