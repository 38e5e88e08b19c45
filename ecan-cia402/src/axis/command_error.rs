//! Rejection of a command to an axis.

use ecan_canopen::{OperatingMode, PdoMappingError};
use thiserror::Error;

use super::units::UnitError;

/// Rejection of a command to an axis; nothing was changed.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum CommandError {
    /// The axis table has no such axis.
    #[error("axis {axis} does not exist")]
    NoSuchAxis {
        /// The invalid index.
        axis: usize,
    },
    /// The axis is not configured, or its drive restarted.
    #[error("axis {axis} is not configured; configure it first")]
    NotConfigured {
        /// Index of the axis.
        axis: usize,
    },
    /// A mode change or homing is running.
    #[error("axis {axis}: a mode change or homing is running; wait for its end")]
    Busy {
        /// Index of the axis.
        axis: usize,
    },
    /// The mode takes its targets from an object that is not mapped; homing has its own command.
    #[error("axis {axis} cannot change to mode {mode}: its target object is not mapped")]
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
        /// Cause.
        error: PdoMappingError,
    },
    /// The value is not a valid target.
    #[error("axis {axis}: {error}")]
    Unit {
        /// Index of the axis.
        axis: usize,
        /// Cause.
        error: UnitError,
    },
}
