//! Errors of an axis table.

use std::fmt;
use std::time::Duration;

use ecan_canopen::{BootProgress, NetworkError, NmtError, PdoMappingError, WaitError};
use ecan_host::CycleError;
use ecan_mcan_port::NotSchedulable;
use thiserror::Error;

use crate::axis::error::AxisFault;
use crate::axis::error::CommandError;
use crate::axis::status::AxisProgress;

/// Reason for which targets or SYNC cannot be scheduled at a phase of Sync0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ScheduleError {
    /// The configuration or a gateway cannot serve it.
    #[error("slave {slave} cannot schedule at {offset_ns} ns: {reason}")]
    NotSchedulable {
        /// Slave index.
        slave: usize,
        /// The offset.
        offset_ns: u32,
        /// Reason.
        reason: NotSchedulable,
    },
    /// An axis is active: an immediate target would overtake one that is still scheduled.
    #[error("axis {axis} is active; disable it first")]
    Active {
        /// Index of the axis.
        axis: usize,
    },
    /// SYNC would be sent before the targets that it makes effective.
    #[error(
        "SYNC at {sync_offset_ns} ns would be sent before the targets at {target_offset_ns} ns"
    )]
    SyncFirst {
        /// Phase of the targets.
        target_offset_ns: u32,
        /// Phase of SYNC.
        sync_offset_ns: u32,
    },
}

/// Faults of an axis table.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisFaults {
    /// Axis and fault, in the order of the table.
    pub faults: Vec<(usize, AxisFault)>,
}

impl fmt::Display for AxisFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the axis table has faults")?;
        self.faults.iter().try_for_each(|(axis, fault)| write!(f, "\n  - axis {axis}: {fault}"))
    }
}

impl std::error::Error for AxisFaults {}

/// Axes that did not reach a state.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisTimeout {
    /// The state.
    pub what: &'static str,
    /// Waiting time by the bus clock.
    pub waited: Duration,
    /// The axes that did not reach it, with their progress.
    pub axes: Vec<AxisProgress>,
    /// Error of the last cycle of a stop: its frames were not sent.
    pub cycle_error: Option<CycleError>,
}

impl AxisTimeout {
    pub(super) const STOPPED: &str = "stopped (may still move)";
    pub(super) const SWITCHED_OFF: &str = "switched off (may still move)";
}

impl fmt::Display for AxisTimeout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.axes.len();
        let axes = if count == 1 { "axis" } else { "axes" };
        write!(f, "{count} {axes} not {} after {} ms", self.what, self.waited.as_millis())?;
        if let Some(error) = &self.cycle_error {
            write!(f, "; the cycle fails: {error}")?;
        }
        self.axes.iter().try_for_each(|axis| write!(f, "\n  - {axis}"))
    }
}

impl std::error::Error for AxisTimeout {}

/// Mandatory nodes that are not booted.
#[derive(Debug, Clone, PartialEq)]
pub struct BootTimeout {
    /// Waiting time by the bus clock.
    pub waited: Duration,
    /// The nodes, with their progress.
    pub nodes: Vec<BootProgress>,
}

impl fmt::Display for BootTimeout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.nodes.len();
        let nodes = if count == 1 { "node" } else { "nodes" };
        write!(f, "{count} mandatory {nodes} not booted after {} ms", self.waited.as_millis())?;
        self.nodes.iter().try_for_each(|node| write!(f, "\n  - {node}"))
    }
}

impl std::error::Error for BootTimeout {}

/// Errors of [`Cia402`](super::Cia402) outside the cycle.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Cia402Error {
    /// The axis table has faults; nothing was changed.
    #[error(transparent)]
    Axes(#[from] AxisFaults),
    /// The network rejected its configuration.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A command was rejected.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// An NMT command could not be queued.
    #[error(transparent)]
    Nmt(#[from] NmtError),
    /// Axes did not reach a state.
    #[error(transparent)]
    AxisTimeout(#[from] AxisTimeout),
    /// Mandatory nodes are not booted.
    #[error(transparent)]
    BootTimeout(#[from] BootTimeout),
    /// The cycle failed while waiting.
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// The PDOs cannot be mapped.
    #[error("axis {axis}: {error}")]
    Mapping {
        /// Index of the axis.
        axis: usize,
        /// Cause.
        error: PdoMappingError,
    },
}
