//! The master ethercrab on simulated gateways: over frames in memory, and over a network interface.
#![allow(missing_docs, clippy::disallowed_macros, clippy::disallowed_methods)]

#[path = "../../../ecan-lite/tests/config_file/common/mod.rs"]
#[allow(dead_code)]
mod config_files;
mod ethercrab_support;
mod list_readers;
mod program;
mod startup_lists;
#[path = "../../../tools/ecan/tests/ecan_sim/support/mod.rs"]
mod support;
mod wire;
