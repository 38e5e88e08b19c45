//! End of a program: one readable message, and a status for scripts.

use std::error::Error;
use std::process::ExitCode;

use ecan_lite::config::ConfigFileError;
use ecan_sim::BackendError;
use ecan_tool_support::command_line::log_file::LogFileError;
use ecan_tool_support::plot::PlotError;
use ecan_tool_support::print_error_line;

/// Exit statuses, with the numbers of `ecan`.
pub const EXIT_STATUS: &str = "\
Exit status:
  0  success
  1  the run failed
  2  invalid arguments
  3  the EtherCAT master library cannot be loaded
  6  file or scenario cannot be read, written or parsed";

/// Success, failure without a message (already printed), or failure with one.
pub fn report_exit(program: &str, result: Result<bool, Box<dyn Error>>) -> ExitCode {
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            print_error_line!("{program}: {error}");
            ExitCode::from(status(&*error))
        }
    }
}

fn status(error: &(dyn Error + 'static)) -> u8 {
    match error.downcast_ref::<BackendError>() {
        Some(error) if error.is_scenario() => 6,
        Some(_) => 3,
        None => {
            let is_file = error.is::<ConfigFileError>()
                || error.is::<LogFileError>()
                || error.is::<PlotError>();
            if is_file { 6 } else { 1 }
        }
    }
}
