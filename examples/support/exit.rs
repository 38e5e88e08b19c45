//! End of a program: one readable message, and a status for scripts.

use std::error::Error;
use std::process::ExitCode;

/// Success, failure without a message (already printed), or failure with one.
pub fn report_exit(program: &str, result: Result<bool, Box<dyn Error>>) -> ExitCode {
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{program}: {error}");
            ExitCode::FAILURE
        }
    }
}
