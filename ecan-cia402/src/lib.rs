//! CiA 402 axes on a CANopen network.
//!
//! A [`Cia402`] drives a table of axes over an [`ecan_canopen::Network`]: startup, state machine,
//! modes, homing, and targets in every cycle. A [`MotionGuard`] per axis prevents jumps; its
//! documentation lists what happens to targets in which case.
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![forbid(unsafe_code)]

mod axis;
mod guard;
mod observation;
mod table;

pub use axis::*;
pub use guard::*;
pub use observation::*;
pub use table::*;
