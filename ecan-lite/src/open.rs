//! Opens the EtherCAT master library that the setting `ecrt` selects.

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

impl OpenEcrt for Ecrt {
    fn open() -> Result<Self> {
        resolve(&EcrtSetting::resolve(None)?)
    }

    fn open_setting(setting: &str) -> Result<Self> {
        resolve(&EcrtSetting::parse(setting))
    }

    fn open_loaded() -> Result<Self> {
        Ok(EcrtSetting::resolve(None)?.find_loaded()?)
    }
}

#[cfg(feature = "sim")]
fn resolve(setting: &EcrtSetting) -> Result<Ecrt> {
    let options = ecan_sim::SimOptions {
        bridges: Some(ecan_sim::bridge::make),
        ..ecan_sim::SimOptions::default()
    };
    let backend = ecan_sim::open(setting, &options)?;
    if let Some(simulation) = &backend.simulation {
        tracing::warn!("{}", simulation.banner());
    }
    Ok(backend.ecrt)
}

#[cfg(not(feature = "sim"))]
fn resolve(setting: &EcrtSetting) -> Result<Ecrt> {
    Ok(setting.load()?)
}
