//! Rejection of a command to an axis.

use ecan_canopen::OperatingMode;
use thiserror::Error;

use super::axis_fault::AxisFault;
use super::interpolation_time::InvalidPeriod;
use super::output_object::OutputObject;
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
    /// The axis is configured or being configured, with a value that the call would change.
    #[error("axis {axis} is configured with the present target period; set it before configure")]
    Configured {
        /// Index of the axis.
        axis: usize,
    },
    /// The target period has no value of the interpolation time 0x60C2.
    #[error("axis {axis}: {}", InvalidPeriod(*period_ns))]
    TargetPeriod {
        /// Index of the axis.
        axis: usize,
        /// Target period in nanoseconds.
        period_ns: u64,
    },
    /// A limit in units of the machine cannot be kept with the target period.
    #[error("axis {axis}: {fault}")]
    Limit {
        /// Index of the axis.
        axis: usize,
        /// Cause.
        fault: AxisFault,
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
    /// The object is not in the process data of the axis.
    #[error("axis {axis}: {output} is not mapped; add it to the outputs of the axis")]
    NotMapped {
        /// Index of the axis.
        axis: usize,
        /// The object.
        output: OutputObject,
    },
    /// The orderly end has begun.
    #[error("axis {axis}: the shutdown has begun; create the axes again to use them")]
    ShuttingDown {
        /// Index of the axis.
        axis: usize,
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
