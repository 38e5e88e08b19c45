//! All tests of the crate in one program; those that need a process of their own are separate.
#![allow(missing_docs)]

mod common;
mod gateway_snapshot;

mod any_snapshot;
mod channel_commands;
mod findings;
mod own_objects;
mod registers;
mod simulated_faults;
mod snapshot;
mod symptoms;
