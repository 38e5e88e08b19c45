//! `ecan firmware`: shows and updates the firmware (manual 15.3.1).

mod access;
mod command;
mod package;
mod update;
#[cfg(test)]
mod update_tests;

pub use command::{FirmwareArguments, run};
