//! Rejection of a command to an axis.

use ecan_canopen::{OperatingMode, PdoMappingError};
use thiserror::Error;

use super::units::UnitError;

/// Why a command to an axis was not taken. Nothing was changed.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum CommandError {
    /// The axis table has no such axis.
    #[error("there is no axis {axis}")]
    NoSuchAxis {
        /// The index given.
        axis: usize,
    },
    /// The axis is not configured, or its drive restarted.
    #[error("axis {axis} is not configured")]
    NotConfigured {
        /// Index of the axis.
        axis: usize,
    },
    /// The axis changes its mode or is homing.
    #[error("axis {axis} changes its mode or is homing")]
    Busy {
        /// Index of the axis.
        axis: usize,
    },
    /// The mode takes its targets from an object that is not mapped; homing has its own command.
    #[error(
        "axis {axis} cannot change to mode {mode}: its process data do not carry what it needs"
    )]
    ModeNotMapped {
        /// Index of the axis.
        axis: usize,
        /// The mode.
        mode: OperatingMode,
    },
    /// The PDOs cannot be mapped.
    #[error("axis {axis}: {error}")]
    Mapping {
        /// Index of the axis.
        axis: usize,
        /// Why not.
        error: PdoMappingError,
    },
    /// The value is no target.
    #[error("axis {axis}: {error}")]
    Unit {
        /// Index of the axis.
        axis: usize,
        /// Why not.
        error: UnitError,
    },
}
