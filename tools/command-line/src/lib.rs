//! What the example programs and the program `ecan` share beyond the SDK: being pleasant on a
//! command line.
#![forbid(unsafe_code)]

pub mod interrupt;
pub mod log_file;
pub mod logging;
pub mod new_file;
pub mod real_time;
