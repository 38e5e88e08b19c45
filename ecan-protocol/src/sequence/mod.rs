//! Configuration of a device step by step: write an object, expect a value, wait for a value.
//!
//! A [`Step`] is plain data. A [`Sequence`] executes a list of steps over an [`ObjectAccess`],
//! without blocking: startup SDOs of a gateway over the EtherCAT mailbox, and the configuration of
//! a CANopen node over SDO on the CAN bus. Device-specific actions, such as an NMT command, are
//! the type parameter of a step.

mod runner;
mod step;

pub use runner::{ObjectAccess, Sequence, SequenceState, Transfer};
pub use step::{Action, Expectation, NoAction, SdoValue, Step, StepError, Tolerance};
