//! Findings of the diagnosis.

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
