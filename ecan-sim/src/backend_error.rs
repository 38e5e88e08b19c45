//! Errors of opening a library or a simulation.

use std::error::Error;
use std::path::PathBuf;

use ecan_can_io::recording::RecordingError;
use ecan_canopen::DeviceFileFaults;
use ecan_protocol::text::{Printable, closest};
use ecrt_sys::{EnvironmentError, LoadError};

use crate::scenario::{BUILTIN_SCENARIOS, MAX_GATEWAYS, ScenarioError};

/// Reason why a library or a simulation cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum BackendError {
    /// The real library cannot be loaded.
    #[error(
        "{0}; without hardware select the simulated master: option --ecrt sim, or the environment \
         variable ECAN_ECRT=sim"
    )]
    Load(#[from] LoadError),
    /// No built-in scenario has this name.
    #[error(
        "unknown scenario \"{}\"{}; allowed: {known}, a number of gateways from 1 to {MAX_GATEWAYS}, or a \
         file name that ends in .toml",
        Printable(.0),
        closest(.0, BUILTIN_SCENARIOS)
            .map_or(String::new(), |near| format!(" (did you mean {near}?)")),
        known = BUILTIN_SCENARIOS.join(", ")
    )]
    UnknownScenario(String),
    /// The environment variable is not UTF-8.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// A file cannot be read.
    #[error("cannot read {}: {}", Printable(.0.display()), .1)]
    Read(PathBuf, std::io::Error),
    /// A bridge of the scenario cannot be made.
    #[error(transparent)]
    Bridge(Box<dyn Error + Send + Sync>),
    /// This node is a bridge, and [`SimOptions::bridges`](crate::SimOptions::bridges) is not set.
    #[error("node \"{0}\" is a bridge; this program does not support bridges")]
    NoBridges(String),
    /// The scenario has an I/O slave with this name, which the front end `esc` does not have.
    #[error(
        "slave \"{0}\" is an I/O, which the simulated wire does not support; remove its [[io]], or \
         use the simulated libethercat"
    )]
    IoOnWire(String),
    /// A scenario file is invalid: its first error.
    #[error("{}: {}", Printable(.0.display()), .1)]
    Scenario(PathBuf, ScenarioError),
    /// The device file (EDS or DCF) of a drive cannot be used: all its faults.
    #[error("{}, {}", Printable(.0.display()), .1)]
    DeviceFile(PathBuf, DeviceFileFaults),
    /// A recording of the scenario is invalid.
    #[error("{}, {}", Printable(.0.display()), .1)]
    Recording(PathBuf, RecordingError),
}

impl BackendError {
    /// Returns true if the scenario or a file of it is the cause, not the library.
    pub fn is_scenario(&self) -> bool {
        !matches!(self, Self::Load(_) | Self::Environment(_))
    }
}
