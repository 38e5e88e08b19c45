//! Shared by `ecan`, `ecan-sim` and the example programs: options, interrupts, log files.

pub mod bit_rate;
pub mod interrupt;
pub mod log_file;
pub mod logging;
pub mod new_file;
pub mod real_time;
pub mod run_info;
pub mod screen;
