//! The error type of applications.

use std::fmt;
use std::path::PathBuf;

use ecan_host::{Ecrt, EcrtSetting};
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

/// Opens the EtherCAT master library that the setting `ecrt` selects: empty for the installed
/// libethercat, a path, `sim`, or `sim:` with a scenario name or file. Nothing falls back to the
/// simulator.
pub trait OpenEcrt: Sized {
    /// Opens the library that the environment variable `ECAN_ECRT` selects.
    ///
    /// # Errors
    /// The library is missing or unusable, or the setting selects a simulator or a scenario that does
    /// not exist.
    fn open() -> Result<Self>;

    /// Opens the library of an explicit setting, regardless of the environment.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    fn open_setting(setting: &str) -> Result<Self>;

    /// The library that this process has loaded already, for
    /// [`Adapter::attach`](crate::adapter::Adapter::attach): an application that runs the master
    /// itself has linked or loaded it. With `sim` in the environment it must be the simulated
    /// libethercat.
    ///
    /// # Errors
    /// The process has loaded no libethercat, or another one than the environment selects.
    fn open_loaded() -> Result<Self>;
}

/// The setting `ecrt` with what a program adds to it. Rust, C and the programs resolve it here;
/// [`OpenEcrt`] has the defaults.
#[derive(Clone, Debug, Default)]
pub struct EcrtOptions {
    /// Setting of the program (API or `--ecrt`); `None` is that of the environment.
    pub setting: Option<String>,
    /// Library if there is no setting; `None` is the installed libethercat.
    pub default_library: Option<PathBuf>,
    /// Options of a simulated library, which has the bridges of its scenario in any case.
    #[cfg(feature = "sim")]
    pub simulation: ecan_sim::SimOptions,
}

/// A library that [`EcrtOptions::open`] has opened.
#[derive(Clone, Debug)]
pub struct OpenedEcrt {
    /// The library.
    pub ecrt: Ecrt,
    /// The simulation that was opened with it, to be announced to the user.
    #[cfg(feature = "sim")]
    pub simulation: Option<ecan_sim::Simulation>,
}

impl EcrtOptions {
    /// Opens the library.
    ///
    /// # Errors
    /// The library is missing or unusable, or the setting selects a simulator or a scenario that does
    /// not exist.
    pub fn open(self) -> Result<OpenedEcrt> {
        let setting = match EcrtSetting::resolve(self.setting.as_deref())? {
            EcrtSetting::Library(None) if self.setting.is_none() => {
                EcrtSetting::Library(self.default_library)
            }
            setting => setting,
        };
        #[cfg(feature = "sim")]
        {
            let bridges = Some(ecan_sim::bridge::make as ecan_sim::BridgeFactory);
            let options = ecan_sim::SimOptions { bridges, ..self.simulation };
            let ecan_sim::Backend { ecrt, simulation } = ecan_sim::open(&setting, &options)?;
            Ok(OpenedEcrt { ecrt, simulation })
        }
        #[cfg(not(feature = "sim"))]
        Ok(OpenedEcrt { ecrt: setting.load()? })
    }

    /// The library that this process has loaded already, see [`OpenEcrt::open_loaded`].
    ///
    /// # Errors
    /// The process has loaded no libethercat, or another one than the setting selects.
    pub fn find_loaded(&self) -> Result<Ecrt> {
        Ok(EcrtSetting::resolve(self.setting.as_deref())?.find_loaded()?)
    }
}

impl OpenEcrt for Ecrt {
    fn open() -> Result<Self> {
        announce(EcrtOptions::default())
    }

    fn open_setting(setting: &str) -> Result<Self> {
        announce(EcrtOptions { setting: Some(setting.to_owned()), ..EcrtOptions::default() })
    }

    fn open_loaded() -> Result<Self> {
        EcrtOptions::default().find_loaded()
    }
}

/// Opens a library; the log names a simulation.
fn announce(options: EcrtOptions) -> Result<Ecrt> {
    let opened = options.open()?;
    #[cfg(feature = "sim")]
    if let Some(simulation) = &opened.simulation {
        tracing::warn!("{}", simulation.banner());
    }
    Ok(opened.ecrt)
}
