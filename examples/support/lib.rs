//! Command line options, reports and plots of the example programs. Applications do not need it.
#![deny(missing_docs, clippy::print_stdout, clippy::print_stderr)]

mod bus_periods;
mod motion_record;
mod phase_table;
mod probe_report;
mod program;
pub mod summary;

pub mod frame_source;
pub mod loop_record;
pub mod loop_setup;
pub mod motion_demo;
pub mod object_value;
pub mod phase_sweep;
pub mod probe_output;
pub mod shift_windows;
pub mod sync0;
pub mod tx_probe;

pub use ecan_tool_support::command_line::interrupt::Interrupt;
pub use ecan_tool_support::command_line::options::RealTimeArguments;
pub use ecan_tool_support::command_line::run_info::RunInfo;
pub use ecan_tool_support::command_line::{interrupt, log_file, options as real_time};
pub use program::{EXIT_STATUS, MasterArguments, report_exit, run_options, wait_ready};
pub use sync0::print_plan;
