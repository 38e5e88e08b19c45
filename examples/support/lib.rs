//! Command line options, reports and plots of the example programs. Applications do not need it.
#![deny(missing_docs, clippy::print_stdout, clippy::print_stderr)]

mod bus_periods;
mod echo_check;
mod exit;
mod motion_record;
mod motion_table;
mod phase_table;
mod plan;
mod probe_report;
mod progress;
mod ready;
mod run_options;
mod session_watch;
mod summary;
mod timeouts;

pub mod backend;
pub mod bus_load;
pub mod clock_plot;
pub mod frame_source;
pub mod gateway_arguments;
pub mod loop_record;
pub mod loop_setup;
pub mod motion_arguments;
pub mod motion_demo;
pub mod object_value;
pub mod phase_sweep;
pub mod probe_output;
pub mod probe_sweep;
pub mod shift_windows;
pub mod sync0;
pub mod tx_probe;

pub use ecan_tool_support::command_line::interrupt::Interrupt;
pub use ecan_tool_support::command_line::options::RealTimeArguments;
pub use ecan_tool_support::command_line::run_info::RunInfo;
pub use ecan_tool_support::command_line::{interrupt, log_file, options as real_time};
pub use exit::{EXIT_STATUS, report_exit};
pub use plan::print_plan;
pub use ready::wait_ready;
pub use run_options::run_options;
