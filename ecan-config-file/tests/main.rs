//! All tests of the crate in one program; those that need a process of their own are separate.
#![allow(missing_docs)]

mod common;
#[path = "../../ecan-sim/tests/ethercrab_support/mod.rs"]
mod ethercrab_support;
mod network_files;
mod startup_lists;

mod axis_names;
mod channel_masks;
mod device;
mod device_profile;
mod exported;
mod network_from_files;
mod reading;
mod reading_axes;
mod reading_bus_yml;
mod reading_nodes;
mod warnings;
