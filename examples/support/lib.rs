//! Command line options, reports and plots of the example programs. Applications do not need it.
#![deny(missing_docs)]

mod exit;
mod motion_table;
mod plan;
mod ready;
mod run_options;

pub mod backend;
pub mod bus_load;
pub mod bus_periods;
pub mod clock_plot;
pub mod echo_check;
pub mod frame_source;
pub mod gateway_arguments;
pub mod histogram;
pub mod loop_record;
pub mod loop_setup;
pub mod motion_arguments;
pub mod motion_demo;
pub mod motion_record;
pub mod object_value;
pub mod phase_sweep;
pub mod phase_table;
pub mod plot;
pub mod probe_output;
pub mod probe_report;
pub mod probe_sweep;
pub mod progress;
pub mod session_watch;
pub mod summary;
pub mod svg;
pub mod timeouts;
pub mod tx_probe;

pub use ecan_command_line::interrupt::Interrupt;
pub use ecan_command_line::real_time::RealTimeArguments;
pub use ecan_command_line::{interrupt, log_file, real_time};
pub use exit::report_exit;
pub use plan::print_plan;
pub use ready::wait_ready;
pub use run_options::run_options;
