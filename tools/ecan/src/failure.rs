//! Errors of a command and their exit status.

use std::path::PathBuf;

use ecan_command_line::interrupt::InterruptError;
use ecan_command_line::log_file::LogFileError;
use ecan_host::MaintenanceError;
use ecan_sim::BackendError;
use thiserror::Error;

/// Error of a command.
#[derive(Debug, Error)]
pub enum Failure {
    /// Problems were found and printed.
    #[error("problems found; see the report above")]
    ProblemsFound,
    /// Invalid argument.
    #[error("{0}")]
    Usage(String),
    /// The EtherCAT library is not available.
    #[error("{0}")]
    Library(#[from] BackendError),
    /// No master, or the master does not respond.
    #[error("{0}")]
    Master(String),
    /// The host denies a resource: real time, a thread or a signal handler.
    #[error("{0}")]
    Host(String),
    /// No such slave, or none selected.
    #[error("{0}")]
    Slave(String),
    /// A slave aborted a transfer or did not respond.
    #[error("{0}")]
    Device(ecan_host::Error),
    /// A slave rejected a request, did not respond, or is in the wrong state.
    #[error("{0}")]
    Rejected(String),
    /// A gateway is not ready.
    #[error("slave {position}: {reason}")]
    NotReady {
        /// Position of the slave.
        position: usize,
        /// Reason.
        reason: String,
    },
    /// Fewer frames than required were received or confirmed as sent.
    #[error("{0}")]
    Incomplete(String),
    /// The user stopped the command before it was complete.
    #[error("{0}")]
    Interrupted(String),
    /// Error of a candump log.
    #[error("{0}")]
    Log(#[from] LogFileError),
    /// An address or terminal for clients is not available.
    #[error("{0}")]
    Bridge(String),
    /// Error of a file.
    #[error("cannot {what} {}: {reason}", path.display())]
    File {
        /// Failed operation: read, write.
        what: &'static str,
        /// Path of the file.
        path: PathBuf,
        /// Reason.
        reason: String,
    },
    /// Standard input cannot be read.
    #[error("cannot read the answer from standard input: {0}")]
    Input(std::io::Error),
    /// Standard output cannot be written.
    #[error("cannot write the output: {0}")]
    Output(std::io::Error),
    /// The reader of standard output has closed it.
    #[error("standard output was closed by its reader")]
    ReaderGone,
}

impl Failure {
    /// Error for a thread that cannot be started.
    pub fn of_thread(error: std::io::Error) -> Self {
        Self::Host(format!("cannot start a thread: {error}"))
    }

    /// Returns the exit status, see [`crate::global::EXIT_STATUS`].
    pub fn status(&self) -> u8 {
        match self {
            Self::ReaderGone => 0,
            Self::ProblemsFound | Self::Incomplete(_) | Self::Interrupted(_) => 1,
            Self::Usage(_) => 2,
            Self::Library(_) | Self::Master(_) => 3,
            Self::Slave(_) => 4,
            Self::Device(_) | Self::Rejected(_) | Self::NotReady { .. } => 5,
            Self::File { .. }
            | Self::Input(_)
            | Self::Output(_)
            | Self::Log(_)
            | Self::Bridge(_) => 6,
            Self::Host(_) => 7,
        }
    }
}

impl From<InterruptError> for Failure {
    fn from(error: InterruptError) -> Self {
        Self::Host(error.to_string())
    }
}

impl From<MaintenanceError> for Failure {
    fn from(error: MaintenanceError) -> Self {
        match error {
            MaintenanceError::Device(error) => Self::Device(error),
            other => Self::Rejected(other.to_string()),
        }
    }
}

/// For errors of standard output only.
impl From<std::io::Error> for Failure {
    fn from(error: std::io::Error) -> Self {
        match error.kind() {
            std::io::ErrorKind::BrokenPipe => Self::ReaderGone,
            _ => Self::Output(error),
        }
    }
}
