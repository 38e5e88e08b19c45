//! Resolves the `ecrt` setting to the real or a simulated library.
//!
//! Only this module selects between the two; it never falls back from the real library to the
//! simulator.

use std::path::{Path, PathBuf};

use ecrt_sys::{Ecrt, EcrtSetting};

use crate::backend_error::BackendError;
use crate::ecrt::simulated_library;
use crate::node::BridgeFactory;
use crate::scenario;
use crate::scenario::{ClockKind, ConfiguredDrive, Scenario};
use crate::simulation::Simulation;

/// File name of standard input.
const STANDARD_INPUT: &str = "-";

/// Scenario of a simulated library.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ScenarioChoice {
    /// The scenario that the program suggests, see [`SimOptions::suggested`].
    Suggested,
    /// A built-in scenario, or the number of gateways with echo nodes.
    Named(String),
    /// A scenario file.
    File(PathBuf),
}

impl ScenarioChoice {
    /// Parses the name of a built-in scenario, a number of gateways with echo nodes, or the name of a
    /// file that ends in `.toml`; `-` is a file on standard input.
    ///
    /// # Errors
    /// [`BackendError::UnknownScenario`].
    pub fn parse(name: &str) -> Result<Self, BackendError> {
        let is_file = Path::new(name).extension().is_some_and(|extension| extension == "toml");
        if is_file || name == STANDARD_INPUT {
            return Ok(Self::File(PathBuf::from(name)));
        }
        match scenario::by_name(name, 1) {
            Some(_) => Ok(Self::Named(name.to_owned())),
            None => Err(BackendError::UnknownScenario(name.to_owned())),
        }
    }

    /// Choice of a simulated [`EcrtSetting`].
    ///
    /// # Errors
    /// [`BackendError::UnknownScenario`].
    pub fn from_setting(name: Option<&str>) -> Result<Self, BackendError> {
        name.map_or(Ok(Self::Suggested), Self::parse)
    }
}

/// Options of the program for a simulated library. The default sets nothing.
#[derive(Clone, Debug, Default)]
pub struct SimOptions {
    /// Built-in scenario for a plain `sim`; `None` is `echo`.
    pub suggested: Option<String>,
    /// Clock if the scenario has none; `None` is [`ClockKind::Real`].
    pub clock: Option<ClockKind>,
    /// Replaces the scenario's seed.
    pub seed: Option<u64>,
    /// Station aliases of the gateways of a built-in scenario, in the order of the bus; 0 is none.
    /// Empty is one gateway without alias.
    pub gateways: Vec<u16>,
    /// Drives that the program configures: a plain `sim` has them in place of the suggested scenario.
    pub drives: Vec<ConfiguredDrive>,
    /// Replaces the scenario's `carries_large_pdos`.
    pub carries_large_pdos: Option<bool>,
    /// Makes the bridges of a scenario file; without it a scenario with a bridge is an error.
    pub bridges: Option<BridgeFactory>,
}

/// A library, with its simulation if it is simulated.
#[derive(Clone, Debug)]
pub struct Backend {
    /// The library.
    pub ecrt: Ecrt,
    /// The simulation; `None` for a loaded library, real or simulated.
    pub simulation: Option<Simulation>,
}

/// Opens the library of a setting.
///
/// A simulated world is some seconds old when this returns: its gateways have booted and the master
/// has scanned them. A process that has loaded the simulated libethercat has its world, so that the
/// simulator is that library then, and the options have no effect.
///
/// # Errors
/// The real library cannot be loaded, or the scenario is invalid.
pub fn open(setting: &EcrtSetting, options: &SimOptions) -> Result<Backend, BackendError> {
    match setting {
        EcrtSetting::Library(path) => {
            Ok(Backend { ecrt: Ecrt::load(path.as_deref())?, simulation: None })
        }
        EcrtSetting::Simulated(name) => {
            if let Some(ecrt) = setting.loaded_simulator()? {
                return Ok(Backend { ecrt, simulation: None });
            }
            let choice = ScenarioChoice::from_setting(name.as_deref())?;
            simulate(&choice, options).map(backend)
        }
    }
}

fn backend(simulation: Simulation) -> Backend {
    Backend { ecrt: simulated_library(&simulation), simulation: Some(simulation) }
}

/// Opens a simulation without a function table, for [`libethercat`].
///
/// [`libethercat`]: crate::libethercat
///
/// # Errors
/// The scenario is invalid.
pub fn simulate(choice: &ScenarioChoice, options: &SimOptions) -> Result<Simulation, BackendError> {
    start(&load_scenario(choice, options)?, options)
}

fn start(scenario: &Scenario, options: &SimOptions) -> Result<Simulation, BackendError> {
    let clock = scenario.clock.or(options.clock).unwrap_or(ClockKind::Real);
    Simulation::new(scenario, clock, options.bridges)
}

/// Loads a scenario and applies the options, except their clock.
///
/// # Errors
/// The scenario does not exist, or its file cannot be read or is invalid.
pub fn load_scenario(
    choice: &ScenarioChoice,
    options: &SimOptions,
) -> Result<Scenario, BackendError> {
    choose(choice, options).map(|scenario| applied(scenario, options))
}

fn applied(mut scenario: Scenario, options: &SimOptions) -> Scenario {
    scenario.seed = options.seed.unwrap_or(scenario.seed);
    let carries_large_pdos = options.carries_large_pdos;
    scenario.carries_large_pdos = carries_large_pdos.unwrap_or(scenario.carries_large_pdos);
    scenario
}

/// Opens a simulated library for a scenario made in memory.
///
/// # Errors
/// A file of the scenario cannot be read or is invalid.
pub fn open_scenario(scenario: Scenario, options: &SimOptions) -> Result<Backend, BackendError> {
    start(&applied(scenario, options), options).map(backend)
}

fn choose(choice: &ScenarioChoice, options: &SimOptions) -> Result<Scenario, BackendError> {
    let gateways = options.gateways.len().max(1);
    let with_aliases = |mut scenario: Scenario| {
        for (gateway, alias) in scenario.gateways.iter_mut().zip(&options.gateways) {
            gateway.alias = *alias;
        }
        scenario
    };
    let named = |name: &str| {
        scenario::by_name(name, gateways)
            .map(with_aliases)
            .ok_or_else(|| BackendError::UnknownScenario(name.to_owned()))
    };
    match choice {
        ScenarioChoice::Suggested if !options.drives.is_empty() => {
            Ok(with_aliases(scenario::configured(gateways, &options.drives)))
        }
        ScenarioChoice::Suggested => named(options.suggested.as_deref().unwrap_or("echo")),
        ScenarioChoice::Named(name) => named(name),
        ScenarioChoice::File(path) => {
            let text = match path.as_os_str() == STANDARD_INPUT {
                true => std::io::read_to_string(std::io::stdin()),
                false => std::fs::read_to_string(path),
            };
            let text = text.map_err(|error| BackendError::Read(path.clone(), error))?;
            let directory = path.parent().unwrap_or(Path::new("."));
            let name = path.display().to_string();
            Scenario::from_toml(&text, &name, directory)
                .map_err(|error| BackendError::Scenario(path.clone(), error))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenario_is_built_in_or_file() {
        let choose = |name| ScenarioChoice::from_setting(name).unwrap();
        assert_eq!(choose(None), ScenarioChoice::Suggested);
        assert_eq!(choose(Some("echo")), ScenarioChoice::Named("echo".into()));
        assert_eq!(
            choose(Some("cells/line 3.toml")),
            ScenarioChoice::File("cells/line 3.toml".into())
        );
    }

    #[test]
    fn unknown_scenario_is_rejected_with_list() {
        let error = open(&EcrtSetting::parse("sim:ecco"), &SimOptions::default()).unwrap_err();
        assert_eq!(
            error.to_string(),
            "unknown scenario \"ecco\" (did you mean echo?); allowed: echo, drives, jitter, a number of \
             gateways from 1 to 100, or a file name that ends in .toml"
        );
    }

    #[test]
    fn number_is_that_of_the_gateways() {
        let gateways = |name| {
            let choice = ScenarioChoice::parse(name)?;
            load_scenario(&choice, &SimOptions::default()).map(|scenario| scenario.gateways.len())
        };
        assert_eq!(gateways("3").unwrap(), 3);
        for wrong in ["0", "101", "-1"] {
            assert!(matches!(gateways(wrong), Err(BackendError::UnknownScenario(_))), "{wrong}");
        }
    }

    #[test]
    fn plain_sim_has_the_gateways_and_drives_of_the_program() {
        let node = ecan_canopen::NodeId::new(9).unwrap();
        let drive = ConfiguredDrive { gateway: 2, channel: 1, node, axes: 2, eds: None };
        let options =
            SimOptions { gateways: vec![0, 7], drives: vec![drive], ..SimOptions::default() };
        let scenario = load_scenario(&ScenarioChoice::Suggested, &options).unwrap();
        let aliases: Vec<u16> = scenario.gateways.iter().map(|gateway| gateway.alias).collect();
        assert_eq!(aliases, [0, 7, 0]);
        let of_channel: Vec<_> = scenario.nodes.iter().filter(|node| node.bus == "2.1").collect();
        let [only] = of_channel[..] else { panic!("{of_channel:?}") };
        let crate::scenario::NodeKind::Drive(spec) = &only.kind else { panic!("{only:?}") };
        assert_eq!((spec.config.node, spec.config.axes), (node, 2));
        assert_eq!(scenario.nodes.len(), 12, "echo nodes on the other channels");
    }

    #[test]
    fn empty_scenario_name_is_rejected() {
        let opened = open(&EcrtSetting::parse("sim:"), &SimOptions::default());
        assert!(matches!(opened, Err(BackendError::UnknownScenario(_))));
    }
}
