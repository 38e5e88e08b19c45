use std::path::{Path, PathBuf};

use ecan_host::RealTimeError;
use ecan_protocol::text::Printable;
use ecan_sim::BackendError;
use ecan_tool_support::command_line::interrupt::InterruptError;
use ecan_tool_support::command_line::log_file::LogFileError;
use thiserror::Error;

use crate::wire::{InterfaceError, SocketError};

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
