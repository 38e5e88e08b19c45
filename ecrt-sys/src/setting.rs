use std::ffi::OsString;
use std::path::PathBuf;

use crate::{ECRT_VARIABLE, Ecrt, LoadError, Origin};

/// The environment variable `ECAN_ECRT` is not valid UTF-8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the environment variable {ECRT_VARIABLE} is not valid UTF-8")]
pub struct EnvironmentError;

/// The setting `ecrt`: which EtherCAT master library a program loads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum EcrtSetting {
    /// The libethercat with this path; `None` is [`DEFAULT_LIBRARY`](crate::DEFAULT_LIBRARY).
    Library(Option<PathBuf>),
    /// The built-in simulator (`ecan_sim::open`) with this scenario; `None` is the scenario that the
    /// program suggests.
    Simulated(Option<String>),
}

impl EcrtSetting {
    /// Reads a setting: an empty text is the default library; `sim` and `sim:<scenario>` are
    /// simulated; any other text is the path of a library.
    pub fn parse(text: &str) -> Self {
        match text.strip_prefix("sim:") {
            Some(scenario) => Self::Simulated(Some(scenario.to_owned())),
            None if text == "sim" => Self::Simulated(None),
            None => Self::Library((!text.is_empty()).then(|| text.into())),
        }
    }

    /// Setting of the environment variable `ECAN_ECRT`. `None` if it is not set or empty, or if the
    /// program runs with more privileges than its user (setuid, setgid, capabilities): the
    /// environment is not trusted then, as with `secure_getenv`.
    ///
    /// # Errors
    /// The value is not valid UTF-8.
    pub fn from_environment() -> Result<Option<Self>, EnvironmentError> {
        // SAFETY: getauxval only reads the process's auxiliary vector.
        if unsafe { libc::getauxval(libc::AT_SECURE) } != 0 {
            return Ok(None);
        }
        Self::from_variable(std::env::var_os(ECRT_VARIABLE))
    }

    fn from_variable(value: Option<OsString>) -> Result<Option<Self>, EnvironmentError> {
        let Some(value) = value.filter(|value| !value.is_empty()) else { return Ok(None) };
        value.to_str().map(Self::parse).map(Some).ok_or(EnvironmentError)
    }

    /// The setting in force: an explicit one (API or `--ecrt`), else that of the environment, else
    /// the default library.
    ///
    /// # Errors
    /// As [`from_environment`](Self::from_environment).
    pub fn resolve(explicit: Option<&str>) -> Result<Self, EnvironmentError> {
        match explicit {
            Some(text) => Ok(Self::parse(text)),
            None => Ok(Self::from_environment()?.unwrap_or(Self::Library(None))),
        }
    }

    /// The library that this process has loaded already, for attaching to a master of the
    /// application. A path selects the loaded library of this path; the simulator is the loaded
    /// simulated libethercat, and otherwise any loaded libethercat is used. Loads nothing, and never
    /// opens a second simulated world.
    ///
    /// # Errors
    /// [`LoadError::NotLoaded`], [`LoadError::NotSimulated`], [`LoadError::OtherScenario`]; otherwise
    /// as [`Ecrt::load`].
    pub fn find_loaded(&self) -> Result<Ecrt, LoadError> {
        match self {
            Self::Library(path) => Ecrt::find_loaded(path.as_deref()),
            Self::Simulated(requested) => Self::simulated(Ecrt::loaded()?, requested.as_deref()),
        }
    }

    /// The simulated libethercat that this process has loaded, if the setting selects the simulator:
    /// a process has one simulated world. `None` without such a library.
    ///
    /// # Errors
    /// [`LoadError::OtherScenario`], [`LoadError::NoWorld`].
    pub fn loaded_simulator(&self) -> Result<Option<Ecrt>, LoadError> {
        let Self::Simulated(requested) = self else { return Ok(None) };
        match Ecrt::loaded() {
            Ok(ecrt) if ecrt.is_simulated() => {
                Self::simulated(ecrt, requested.as_deref()).map(Some)
            }
            Err(error @ LoadError::NoWorld { .. }) => Err(error),
            // any other library is not that of the setting
            _ => Ok(None),
        }
    }

    /// Compares a loaded library with a simulated setting.
    fn simulated(ecrt: Ecrt, requested: Option<&str>) -> Result<Ecrt, LoadError> {
        match (ecrt.origin(), requested) {
            (origin @ Origin::Library { .. }, _) => {
                Err(LoadError::NotSimulated { library: origin.to_string() })
            }
            (Origin::Simulated { scenario }, Some(requested)) if scenario != requested => {
                let (requested, loaded) = (requested.to_owned(), scenario.clone());
                Err(LoadError::OtherScenario { requested, loaded })
            }
            _ => Ok(ecrt),
        }
    }

    /// Loads the library in a program that was built without the simulator.
    ///
    /// # Errors
    /// As [`Ecrt::load`], and [`LoadError::NoSimulator`] for a simulated one.
    pub fn load(&self) -> Result<Ecrt, LoadError> {
        match self {
            Self::Library(path) => Ecrt::load(path.as_deref()),
            Self::Simulated(_) => self.loaded_simulator()?.ok_or(LoadError::NoSimulator),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::ffi::OsStringExt;

    use super::*;

    #[test]
    fn setting_names_library_or_scenario() {
        assert_eq!(EcrtSetting::parse(""), EcrtSetting::Library(None));
        assert_eq!(
            EcrtSetting::parse("/opt/etherlab/lib/libethercat.so.1"),
            EcrtSetting::Library(Some("/opt/etherlab/lib/libethercat.so.1".into()))
        );
        assert_eq!(EcrtSetting::parse("sim"), EcrtSetting::Simulated(None));
        assert_eq!(EcrtSetting::parse("sim:echo"), EcrtSetting::Simulated(Some("echo".into())));
    }

    #[test]
    fn explicit_setting_precedes_environment() {
        assert_eq!(EcrtSetting::resolve(Some("sim")), Ok(EcrtSetting::Simulated(None)));
    }

    #[test]
    fn empty_variable_counts_as_unset() {
        let read = EcrtSetting::from_variable;
        assert_eq!(read(None), Ok(None));
        assert_eq!(read(Some("".into())), Ok(None));
        assert_eq!(
            read(Some("sim:echo".into())),
            Ok(Some(EcrtSetting::Simulated(Some("echo".into()))))
        );
        assert_eq!(read(Some(OsString::from_vec(vec![0xFF]))), Err(EnvironmentError));
    }

    #[test]
    fn sim_without_simulator_is_rejected() {
        let loaded = EcrtSetting::Simulated(None).load();
        assert_eq!(loaded.err(), Some(LoadError::NoSimulator));
    }
}
