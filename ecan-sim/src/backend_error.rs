//! Errors of opening a library or a simulation.

use std::error::Error;
use std::path::PathBuf;

use ecrt_sys::{EnvironmentError, LoadError};

use crate::drive::EdsError;
use crate::scenario::{BUILTIN_SCENARIOS, ScenarioError};

/// Reason why a library or a simulation cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum BackendError {
    /// The real library cannot be loaded.
    #[error("{0}; without hardware select the simulated master with the setting `sim`")]
    Load(#[from] LoadError),
    /// No built-in scenario has this name.
    #[error(
        "unknown scenario \"{name}\"; allowed: {}, or a file name that ends in .toml",
        BUILTIN_SCENARIOS.join(", ")
    )]
    UnknownScenario {
        /// The name.
        name: String,
    },
    /// The environment variable is not UTF-8.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// A file cannot be read.
    #[error("cannot read {}: {error}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        error: std::io::Error,
    },
    /// A bridge of the scenario cannot be made.
    #[error(transparent)]
    Bridge(Box<dyn Error + Send + Sync>),
    /// The scenario has a bridge, and [`SimOptions::bridges`](crate::SimOptions::bridges) is not set.
    #[error("node \"{node}\" is a bridge; this program does not support bridges")]
    NoBridges {
        /// The node.
        node: String,
    },
    /// A scenario file is invalid.
    #[error("{}: {error}", path.display())]
    Scenario {
        /// The file.
        path: PathBuf,
        /// The first error in it.
        error: ScenarioError,
    },
    /// The EDS of a drive is invalid.
    #[error("{}, {error}", path.display())]
    Eds {
        /// The file.
        path: PathBuf,
        /// The first error in it.
        error: EdsError,
    },
    /// A candump log of the scenario is invalid.
    #[error("{}, line {line}: {reason}", path.display())]
    Log {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The first error in it.
        reason: String,
    },
}
