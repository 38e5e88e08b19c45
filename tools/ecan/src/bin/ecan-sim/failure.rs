//! Errors of `ecan-sim` with their exit statuses, and its output.

use std::fmt::Display;
use std::io;
use std::io::Write;
use std::path::{Path, PathBuf};

use ecan_host::RealTimeError;
use ecan_protocol::text::Printable;
use ecan_sim::BackendError;
use ecan_tool_support::command_line::interrupt::InterruptError;
use ecan_tool_support::command_line::log_file::LogFileError;
use ecan_tool_support::command_line::screen::{CleanWriter, Stream};
use ecan_tool_support::{print_error_line, print_line};
use thiserror::Error;

use crate::packet_socket::{InterfaceError, SocketError};

/// Exit statuses, with the numbers of `ecan`.
pub const EXIT_STATUS: &str = "\
Exit status:
  0  success
  2  invalid arguments
  3  network interface is missing, down, or not permitted
  6  file or scenario cannot be read, written or parsed
  7  host denied a resource: real time (--rt-required) or a thread";

#[derive(Debug, Error)]
pub enum Failure {
    #[error(transparent)]
    Scenario(#[from] BackendError),
    #[error("{} has no gateway", Printable(.0.display()))]
    NoGateway(PathBuf),
    #[error(transparent)]
    Interface(#[from] InterfaceError),
    #[error(transparent)]
    Socket(#[from] SocketError),
    #[error(transparent)]
    Log(#[from] LogFileError),
    #[error("cannot {what} {}: {reason}", Printable(path.display()))]
    File { what: &'static str, path: PathBuf, reason: std::io::Error },
    #[error("cannot write the output: {0}")]
    Output(std::io::Error),
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    #[error(transparent)]
    Interrupt(#[from] InterruptError),
    #[error(transparent)]
    RealTime(#[from] RealTimeError),
}

impl Failure {
    /// Error of a file; `what` is the failed operation, for example "read".
    pub fn file(what: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |reason| Self::File { what, path, reason }
    }

    /// Returns the exit status, see [`EXIT_STATUS`].
    pub fn status(&self) -> u8 {
        match self {
            Self::Interface(_) | Self::Socket(_) => 3,
            Self::Scenario(_)
            | Self::NoGateway(_)
            | Self::Log(_)
            | Self::File { .. }
            | Self::Output(_)
            | Self::Json(_) => 6,
            Self::Interrupt(_) | Self::RealTime(_) => 7,
        }
    }
}

/// Stream of the messages: standard output, or standard error if standard output carries data.
/// Write errors are ignored, so that a closed pipe does not end the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Screen {
    Output,
    OutputIsData,
}

impl Screen {
    pub fn line(self, line: impl Display) {
        match self {
            Self::Output => print_line!("{line}"),
            Self::OutputIsData => print_error_line!("{line}"),
        }
    }

    pub fn error(error: &dyn Display) {
        print_error_line!("ecan-sim: {error}");
    }
}

/// Prints data on standard output. A closed pipe is not an error.
pub fn print(data: &[u8]) -> Result<(), Failure> {
    let mut output = CleanWriter::new(Stream::Output);
    match output.write_all(data).and_then(|()| output.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::Output(error)),
        _ => Ok(()),
    }
}
