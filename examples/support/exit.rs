//! How a program ends: one readable message, and a status that scripts can use.

use std::error::Error;
use std::process::ExitCode;

/// Success, failure without a message (it was printed already), or failure with one.
pub fn report(program: &str, outcome: Result<bool, Box<dyn Error>>) -> ExitCode {
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{program}: {error}");
            ExitCode::FAILURE
        }
    }
}
