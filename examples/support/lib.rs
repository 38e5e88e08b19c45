//! Command line options, reports and plots of the example programs. Applications do not need it.
#![deny(missing_docs)]

pub mod backend;
pub mod bus_load;
pub mod bus_periods;
pub mod clock_plot;
pub mod echo_check;
pub mod exit;
pub mod gateway_arguments;
pub mod histogram;
pub mod motion;
mod motion_table;
pub mod object_value;
pub mod open;
pub mod plan;
pub mod plot;
pub mod probe_report;
pub mod progress;
pub mod session_watch;
pub mod source;
pub mod summary;
pub mod svg;
pub mod timeouts;
pub mod tx_probe;

pub use ecan_command_line::{interrupt, log_file, real_time};

/// The programs in the README compile.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
