//! From the `ecrt` setting to a library: the real one or a simulated one.
//!
//! This is the only place that chooses between the two, and it never falls back from the real
//! library to the simulator by itself.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use ecrt_sys::Ecrt;

use crate::backend_error::{BackendError, ECRT_VARIABLE};
use crate::ecrt::{secure_execution, simulated_library};
use crate::node::BridgeFactory;
use crate::scenario::{self, BUILTIN_SCENARIOS, ClockKind, Scenario};
use crate::simulation::Simulation;

/// Which scenario a simulated library runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ScenarioChoice {
    /// The one that the program suggests, see [`SimOptions::suggested`].
    Suggested,
    /// A built-in one.
    Named(String),
    /// A file.
    File(PathBuf),
    /// One made in memory.
    Given(Box<Scenario>),
}

impl ScenarioChoice {
    /// Reads the name of a built-in scenario, or of a file that ends in `.toml`.
    ///
    /// # Errors
    /// [`BackendError::UnknownScenario`].
    pub fn parse(name: &str) -> Result<Self, BackendError> {
        if Path::new(name).extension().is_some_and(|extension| extension == "toml") {
            return Ok(Self::File(PathBuf::from(name)));
        }
        if BUILTIN_SCENARIOS.contains(&name) {
            return Ok(Self::Named(name.to_owned()));
        }
        Err(BackendError::UnknownScenario { name: name.to_owned() })
    }
}

/// The `ecrt` setting: which libethercat to use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum EcrtSetting {
    /// The real library: the one named, or the default one.
    Library(Option<PathBuf>),
    /// A simulated library.
    Sim(ScenarioChoice),
}

impl EcrtSetting {
    /// Reads a setting: empty is the default library; `sim`, `sim:<name>` and `sim:<file>.toml`
    /// are simulated; everything else is the path of a library.
    ///
    /// # Errors
    /// [`BackendError::UnknownScenario`].
    pub fn parse(text: &str) -> Result<Self, BackendError> {
        if text.is_empty() {
            return Ok(Self::Library(None));
        }
        if text == "sim" {
            return Ok(Self::Sim(ScenarioChoice::Suggested));
        }
        match text.strip_prefix("sim:") {
            Some(name) => ScenarioChoice::parse(name).map(Self::Sim),
            None => Ok(Self::Library(Some(PathBuf::from(text)))),
        }
    }

    /// The setting of the environment variable `ECAN_ECRT`; `None` when it is not set, or when the
    /// program runs with more rights than its user has (setuid, setgid, capabilities): then the
    /// environment is not to be trusted, as for `secure_getenv`.
    ///
    /// # Errors
    /// As [`parse`](Self::parse), and [`BackendError::Environment`] for a value that is not text.
    pub fn from_environment() -> Result<Option<Self>, BackendError> {
        if secure_execution() {
            return Ok(None);
        }
        Self::from_variable(std::env::var_os(ECRT_VARIABLE))
    }

    fn from_variable(value: Option<OsString>) -> Result<Option<Self>, BackendError> {
        match value {
            None => Ok(None),
            Some(value) if value.is_empty() => Ok(None),
            Some(value) => {
                let text = value.to_str().ok_or(BackendError::Environment)?;
                Self::parse(text).map(Some)
            }
        }
    }

    /// The setting in force: an explicit one (API or `--ecrt`), else the environment's, else the
    /// default library.
    ///
    /// # Errors
    /// As [`parse`](Self::parse) and [`from_environment`](Self::from_environment).
    pub fn resolve(explicit: Option<&str>) -> Result<Self, BackendError> {
        match explicit {
            Some(text) => Self::parse(text),
            None => Ok(Self::from_environment()?.unwrap_or(Self::Library(None))),
        }
    }
}

/// Options of the program for a simulated library. The default sets nothing.
#[derive(Clone, Debug, Default)]
pub struct SimOptions {
    /// Built-in scenario for a plain `sim`; `None` is `echo`.
    pub suggested: Option<String>,
    /// Clock unless the scenario names one; `None` is [`ClockKind::Real`].
    pub clock: Option<ClockKind>,
    /// Seed in place of the scenario's.
    pub seed: Option<u64>,
    /// Gateways of a built-in scenario; `None` is 1.
    pub slaves: Option<usize>,
    /// Whether the simulated master carries large PDOs, in place of the scenario's word.
    pub carries_large_pdos: Option<bool>,
    /// Makes the bridges of a scenario file; without it a scenario with a bridge is an error.
    pub bridges: Option<BridgeFactory>,
}

/// A library, and the simulation behind it if it is a simulated one.
#[derive(Clone, Debug)]
pub struct Backend {
    /// The library.
    pub ecrt: Ecrt,
    /// The simulation; `None` for a real library.
    pub simulation: Option<Simulation>,
}

/// Opens the library that the setting names.
///
/// A simulated world is some seconds old when this returns: its gateways have booted and the
/// master has scanned them.
///
/// # Errors
/// The real library's error, or what is wrong with the scenario.
pub fn open(setting: &EcrtSetting, options: &SimOptions) -> Result<Backend, BackendError> {
    match setting {
        EcrtSetting::Library(path) => {
            Ok(Backend { ecrt: Ecrt::load(path.as_deref())?, simulation: None })
        }
        EcrtSetting::Sim(choice) => {
            let simulation = simulate(choice, options)?;
            Ok(Backend { ecrt: simulated_library(&simulation), simulation: Some(simulation) })
        }
    }
}

/// Opens a simulation without the table of a library in front, for [`libethercat`].
///
/// [`libethercat`]: crate::libethercat
///
/// # Errors
/// What is wrong with the scenario.
pub fn simulate(choice: &ScenarioChoice, options: &SimOptions) -> Result<Simulation, BackendError> {
    let scenario = load_scenario(choice, options)?;
    let clock = scenario.clock.or(options.clock).unwrap_or(ClockKind::Real);
    Simulation::new(&scenario, clock, options.bridges)
}

/// The scenario of a choice, with what the options put in place of its own words; reads the file if
/// it is one. Their clock is left to whoever runs it.
///
/// # Errors
/// There is no such scenario, or its file cannot be read or is wrong.
pub fn load_scenario(
    choice: &ScenarioChoice,
    options: &SimOptions,
) -> Result<Scenario, BackendError> {
    let mut scenario = choose(choice, options)?;
    if let Some(seed) = options.seed {
        scenario.seed = seed;
    }
    if let Some(carries) = options.carries_large_pdos {
        scenario.carries_large_pdos = carries;
    }
    Ok(scenario)
}

/// Opens a simulated library for a scenario made in memory.
///
/// # Errors
/// What is wrong with the scenario's files.
pub fn open_scenario(scenario: Scenario, options: &SimOptions) -> Result<Backend, BackendError> {
    open(&EcrtSetting::Sim(ScenarioChoice::Given(Box::new(scenario))), options)
}

fn choose(choice: &ScenarioChoice, options: &SimOptions) -> Result<Scenario, BackendError> {
    let named = |name: &str| {
        scenario::by_name(name, options.slaves.unwrap_or(1))
            .ok_or_else(|| BackendError::UnknownScenario { name: name.to_owned() })
    };
    match choice {
        ScenarioChoice::Suggested => named(options.suggested.as_deref().unwrap_or("echo")),
        ScenarioChoice::Named(name) => named(name),
        ScenarioChoice::Given(scenario) => Ok(Scenario::clone(scenario)),
        ScenarioChoice::File(path) => {
            let text = std::fs::read_to_string(path)
                .map_err(|error| BackendError::Read { path: path.clone(), error })?;
            let directory = path.parent().unwrap_or(Path::new("."));
            let name = path.display().to_string();
            Scenario::from_toml(&text, &name, directory)
                .map_err(|error| BackendError::Scenario { path: path.clone(), error })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_told_apart() {
        let parse = |text| EcrtSetting::parse(text).unwrap();
        assert_eq!(parse(""), EcrtSetting::Library(None));
        assert_eq!(
            parse("/opt/etherlab/lib/libethercat.so.1"),
            EcrtSetting::Library(Some("/opt/etherlab/lib/libethercat.so.1".into()))
        );
        assert_eq!(parse("sim"), EcrtSetting::Sim(ScenarioChoice::Suggested));
        assert_eq!(parse("sim:echo"), EcrtSetting::Sim(ScenarioChoice::Named("echo".into())));
        assert_eq!(
            parse("sim:cells/line 3.toml"),
            EcrtSetting::Sim(ScenarioChoice::File("cells/line 3.toml".into()))
        );
    }

    #[test]
    fn an_unknown_scenario_is_refused_with_the_list() {
        let error = EcrtSetting::parse("sim:ecco").unwrap_err();
        assert_eq!(
            error.to_string(),
            "there is no scenario \"ecco\"; there are: echo, drives, jitter, or the name of a file that \
             ends in .toml"
        );
    }

    #[test]
    fn an_explicit_setting_wins() {
        assert_eq!(
            EcrtSetting::resolve(Some("sim")).unwrap(),
            EcrtSetting::Sim(ScenarioChoice::Suggested)
        );
    }

    #[test]
    fn the_variable_is_read_like_the_option() {
        let read = |value: Option<&str>| EcrtSetting::from_variable(value.map(OsString::from));
        assert_eq!(read(None).unwrap(), None);
        assert_eq!(read(Some("")).unwrap(), None);
        assert_eq!(
            read(Some("sim:echo")).unwrap(),
            Some(EcrtSetting::Sim(ScenarioChoice::Named("echo".into())))
        );
        assert!(matches!(read(Some("sim:")), Err(BackendError::UnknownScenario { .. })));
    }
}
