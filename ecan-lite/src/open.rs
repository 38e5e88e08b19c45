//! Opens the EtherCAT master library that the setting `ecrt` selects.

use std::path::PathBuf;

use ecan_host::{Ecrt, EcrtSetting};

use crate::Result;

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
        let ecrt = EcrtOptions::default().find_loaded()?;
        warn_of_release(&ecrt);
        Ok(ecrt)
    }
}

/// Opens a library; the log names a simulation, and a release that was not tested.
fn announce(options: EcrtOptions) -> Result<Ecrt> {
    let opened = options.open()?;
    #[cfg(feature = "sim")]
    if let Some(simulation) = &opened.simulation {
        tracing::warn!("{}", simulation.banner());
    }
    warn_of_release(&opened.ecrt);
    Ok(opened.ecrt)
}

fn warn_of_release(ecrt: &Ecrt) {
    if let Some(warning) = ecrt.release_warning() {
        tracing::warn!("{warning}");
    }
}
