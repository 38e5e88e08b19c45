//! Configuration of a device step by step: write an object, expect a value, wait for a value.
//!
//! A [`Step`] is plain data. A [`Sequence`] executes a list of steps over an [`ObjectAccess`],
//! without blocking: startup SDOs of a gateway over the EtherCAT mailbox, and the configuration of
//! a CANopen node over SDO on the CAN bus. Device-specific actions, such as an NMT command, are
//! the type parameter of a step.

mod expectation;
mod object_access;
mod runner;
mod sdo_value;
mod step;
mod step_error;

pub use expectation::Expectation;
pub use object_access::{NoAction, ObjectAccess, Transfer};
pub use runner::{Sequence, SequenceState};
pub use sdo_value::SdoValue;
pub use step::{Action, Step, Tolerance};
pub use step_error::StepError;
