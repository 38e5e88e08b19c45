//! The program `ecan`; the library of this package is the program without its process.
#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(ecan::run(std::env::args_os()))
}
