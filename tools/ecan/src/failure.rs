//! Why a command failed, and the exit status that says so.

use std::path::PathBuf;

use ecan_command_line::interrupt::InterruptError;
use ecan_command_line::log_file::LogFileError;
use ecan_host::MaintenanceError;
use ecan_sim::BackendError;
use thiserror::Error;

/// Why a command failed.
#[derive(Debug, Error)]
pub enum Failure {
    /// Something was looked at and is amiss; it was printed already.
    #[error("something is amiss, see above")]
    Amiss,
    /// An argument that only the program can judge.
    #[error("{0}")]
    Usage(String),
    /// There is no library.
    #[error("{0}")]
    Library(#[from] BackendError),
    /// There is no master, or it cannot be asked.
    #[error("{0}")]
    Master(String),
    /// This host does not give what the program asks it for: real time, a thread, its signals.
    #[error("{0}")]
    Host(String),
    /// No slave, or none chosen.
    #[error("{0}")]
    Slave(String),
    /// A slave refused, or did not answer.
    #[error("{0}")]
    Device(ecan_host::Error),
    /// A slave refused, did not answer, or is in no state for it, by other words than the library's.
    #[error("{0}")]
    Refused(String),
    /// A gateway is not in service.
    #[error("the gateway at position {position}: {reason}")]
    OutOfService {
        /// Its place in the ring.
        position: usize,
        /// Why.
        reason: String,
    },
    /// Fewer frames than were asked for came, or are known to have left.
    #[error("{0}")]
    TooFew(String),
    /// The user gave up before all was done.
    #[error("{0}")]
    Interrupted(String),
    /// A CAN log.
    #[error("{0}")]
    Log(#[from] LogFileError),
    /// An address or a terminal for other programs cannot be had.
    #[error("{0}")]
    Bridge(String),
    /// A file.
    #[error("cannot {what} {}: {reason}", path.display())]
    File {
        /// What was tried: read, write.
        what: &'static str,
        /// Which.
        path: PathBuf,
        /// Why it failed.
        reason: String,
    },
    /// Standard input cannot be read.
    #[error("cannot read the answer from standard input: {0}")]
    Input(std::io::Error),
    /// Standard output cannot be written.
    #[error("cannot write the output: {0}")]
    Output(std::io::Error),
    /// The reader of standard output went away.
    #[error("the reader of the output went away")]
    ReaderGone,
}

impl Failure {
    /// That a thread cannot be started.
    pub fn of_thread(error: std::io::Error) -> Self {
        Self::Host(format!("cannot start a thread: {error}"))
    }

    /// The exit status, see [`crate::global::EXIT_STATUS`].
    pub fn status(&self) -> u8 {
        match self {
            Self::ReaderGone => 0,
            Self::Amiss | Self::TooFew(_) | Self::Interrupted(_) => 1,
            Self::Usage(_) => 2,
            Self::Library(_) | Self::Master(_) => 3,
            Self::Slave(_) => 4,
            Self::Device(_) | Self::Refused(_) | Self::OutOfService { .. } => 5,
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
            other => Self::Refused(other.to_string()),
        }
    }
}

/// Of standard output alone: what else can go wrong with the system is told by its own words.
impl From<std::io::Error> for Failure {
    fn from(error: std::io::Error) -> Self {
        match error.kind() {
            std::io::ErrorKind::BrokenPipe => Self::ReaderGone,
            _ => Self::Output(error),
        }
    }
}
