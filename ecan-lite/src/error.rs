//! The error type of applications.

use std::fmt;

use thiserror::Error as ThisError;

/// Result with an [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Any error of the SDK. Its `Debug` form is the message with its causes, so that a `main` that returns
/// it prints a readable line.
#[derive(ThisError)]
#[non_exhaustive]
pub enum Error {
    /// The environment variable `ECAN_ECRT` is invalid.
    #[error(transparent)]
    Environment(#[from] ecan_host::EnvironmentError),
    /// The EtherCAT master library cannot be loaded.
    #[error(transparent)]
    Load(#[from] ecan_host::LoadError),
    /// The library or the scenario that the setting `ecrt` selects cannot be opened.
    #[cfg(feature = "sim")]
    #[error(transparent)]
    Open(#[from] ecan_sim::BackendError),
    /// The configuration file is faulty.
    #[cfg(feature = "config-file")]
    #[error(transparent)]
    ConfigFile(#[from] crate::config_file::ConfigFileError),
    /// The Adapter failed.
    #[error(transparent)]
    Adapter(#[from] ecan_host::Error),
    /// The Port failed.
    #[error(transparent)]
    Port(#[from] ecan_mcan_port::PortError),
    /// A slave or channel does not exist.
    #[error(transparent)]
    Address(#[from] ecan_mcan_port::AddressError),
    /// A CAN ID or a frame is invalid.
    #[error(transparent)]
    Frame(#[from] ecan_protocol::can::FrameError),
    /// A frame was rejected.
    #[error(transparent)]
    Send(#[from] ecan_mcan_port::SendError),
    /// No frame was delivered.
    #[error(transparent)]
    Delivery(#[from] ecan_mcan_port::NotDelivered),
    /// A cycle failed.
    #[error(transparent)]
    Cycle(#[from] ecan_host::CycleError),
    /// Real-time settings were denied.
    #[error(transparent)]
    RealTime(#[from] ecan_host::RealTimeError),
    /// The CANopen network failed.
    #[cfg(feature = "cia402")]
    #[error(transparent)]
    Network(#[from] ecan_canopen::NetworkError),
    /// The axis table is faulty.
    #[cfg(feature = "cia402")]
    #[error(transparent)]
    AxisTable(#[from] ecan_cia402::Cia402Error),
    /// An axis rejected a command.
    #[cfg(feature = "cia402")]
    #[error(transparent)]
    Command(#[from] ecan_cia402::CommandError),
    /// A blocking call failed.
    #[cfg(feature = "cia402")]
    #[error(transparent)]
    Wait(#[from] ecan_canopen::WaitError),
    /// Input or output of the application.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// Text of the application.
    #[error("{0}")]
    Text(String),
}

impl Error {
    /// Returns true if the same call can succeed later without a change by the application:
    /// link lost, slave restarting, queue full (`ecan_result_is_temporary` in C).
    pub fn is_temporary(&self) -> bool {
        match self {
            Self::Adapter(error) => error.is_temporary(),
            Self::Port(error) => error.is_temporary(),
            Self::Send(error) => error.is_temporary(),
            Self::Cycle(error) => error.is_temporary(),
            _ => false,
        }
    }
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = self.to_string();
        f.write_str(&text)?;
        let mut cause = std::error::Error::source(self);
        while let Some(error) = cause {
            let next = error.to_string();
            // Some messages already contain that of their cause.
            if !text.contains(&next) {
                write!(f, ": {next}")?;
            }
            text = next;
            cause = error.source();
        }
        Ok(())
    }
}

impl From<&str> for Error {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Error {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}
