//! Shared by `ecan`, `ecan-sim` and the example programs: options, interrupts, log files.

pub mod interrupt;
pub mod log_file;
pub mod new_file;
pub mod options;
pub mod run_info;
pub mod screen;
