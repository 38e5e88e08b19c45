use std::path::{Path, PathBuf};

use ecan_host::{MaintenanceError, RealTimeError};
use ecan_mcan_port::PortError;
use ecan_protocol::text::Printable;
use ecan_sim::BackendError;
use ecan_tool_support::command_line::interrupt::InterruptError;
use ecan_tool_support::command_line::log_file::LogFileError;
use thiserror::Error;

/// Result of a command or a part of it.
pub type Result<T = (), E = Failure> = std::result::Result<T, E>;

#[derive(Debug, Error)]
pub enum Failure {
    #[error("problems found; see the report above")]
    ProblemsFound,
    #[error("{0}")]
    Usage(String),
    #[error("{0}")]
    Library(#[from] BackendError),
    /// No master, or the master does not respond.
    #[error("{0}")]
    Master(String),
    /// The host denies a resource: real time, a thread or a signal handler.
    #[error("{0}")]
    Host(String),
    #[error(transparent)]
    Interrupt(#[from] InterruptError),
    #[error(transparent)]
    RealTime(#[from] RealTimeError),
    /// No such slave, or none selected.
    #[error("{0}")]
    Slave(String),
    /// A slave aborted a transfer or did not respond.
    #[error("{0}")]
    Device(#[from] ecan_host::Error),
    /// A slave rejected a request, did not respond, or is in the wrong state.
    #[error("{0}")]
    Rejected(String),
    #[error("slave {position}: {reason}")]
    NotReady { position: usize, reason: String },
    /// Fewer frames than required were received or confirmed as sent, or the user stopped before.
    #[error("{0}")]
    Incomplete(String),
    #[error("{0}")]
    Log(#[from] LogFileError),
    /// An address or terminal for clients is not available.
    #[error("{0}")]
    Bridge(String),
    /// Zenoh rejects its configuration, or opens no session with it.
    #[cfg(feature = "zenoh")]
    #[error("{0}")]
    Publication(String),
    /// A failure after which a bundle was written.
    #[error("{failure}\nwritten to {}", Printable(path.display()))]
    Recorded { failure: Box<Failure>, path: PathBuf },
    #[error("cannot {what} {}: {reason}", Printable(path.display()))]
    File { what: &'static str, path: PathBuf, reason: String },
    #[error("cannot read the answer from standard input: {0}")]
    Input(std::io::Error),
    #[error("cannot write the output: {0}")]
    Output(std::io::Error),
    #[error("standard output was closed by its reader")]
    ReaderGone,
}

impl Failure {
    /// Error of a file; `what` is the failed operation, for example "read".
    pub fn file(what: &'static str, path: &Path, reason: impl ToString) -> Self {
        Self::File { what, path: path.to_owned(), reason: reason.to_string() }
    }

    pub fn master(error: impl ToString) -> Self {
        Self::Master(error.to_string())
    }

    /// Error of [`Port::diagnose`](ecan_mcan_port::Port::diagnose) itself.
    pub fn of_diagnosis(error: PortError) -> Self {
        match error {
            PortError::Adapter(error @ ecan_host::Error::Thread { .. }) => Self::Device(error),
            error => Self::master(error),
        }
    }

    pub fn of_thread(error: std::io::Error) -> Self {
        Self::Host(format!("cannot start a thread: {error}"))
    }

    /// Returns the exit status, see [`crate::global::EXIT_STATUS`].
    pub fn status(&self) -> u8 {
        match self {
            Self::ReaderGone => 0,
            Self::Recorded { failure, .. } => failure.status(),
            Self::ProblemsFound | Self::Incomplete(_) => 1,
            Self::Usage(_) => 2,
            Self::Library(error) if error.is_scenario() => 6,
            Self::Library(_) | Self::Master(_) => 3,
            Self::Device(
                ecan_host::Error::NotPermitted { .. }
                | ecan_host::Error::Disconnected { .. }
                | ecan_host::Error::NoLink,
            ) => 3,
            Self::Device(ecan_host::Error::Thread { .. }) => 7,
            Self::Slave(_)
            | Self::Device(ecan_host::Error::NoSlaves | ecan_host::Error::NoSuchSlave { .. }) => 4,
            Self::Device(_) | Self::Rejected(_) | Self::NotReady { .. } => 5,
            Self::File { .. } | Self::Input(_) | Self::Output(_) | Self::Log(_) => 6,
            #[cfg(feature = "zenoh")]
            Self::Publication(_) => 6,
            Self::Host(_) | Self::Bridge(_) | Self::Interrupt(_) | Self::RealTime(_) => 7,
        }
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
