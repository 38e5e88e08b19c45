//! Errors of an axis table.

use std::fmt;
use std::time::Duration;

use ecan_canopen::{NetworkError, NmtError, PdoMappingError, WaitError};
use ecan_mcan_port::NotSchedulable;
use ecan_protocol::mapping::Direction;
use thiserror::Error;

use crate::axis::command_error::CommandError;
use crate::axis::config::AxisFault;
use crate::axis::phase::AxisProgress;

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
}

impl fmt::Display for AxisTimeout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.axes.len();
        let axes = if count == 1 { "axis" } else { "axes" };
        write!(f, "{count} {axes} not {} after {} ms", self.what, self.waited.as_millis())?;
        self.axes.iter().try_for_each(|axis| write!(f, "\n  - {axis}"))
    }
}

impl std::error::Error for AxisTimeout {}

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
    /// The cycle failed while waiting.
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// The axis table names a gateway that the Port does not have.
    #[error("axis {axis}: slave {slave} does not exist; the Port has {slaves}")]
    NoSuchSlave {
        /// Index of the axis.
        axis: usize,
        /// The invalid slave index.
        slave: usize,
        /// Gateways of the Port.
        slaves: usize,
    },
    /// The PDOs cannot be mapped.
    #[error("axis {axis}: {error}")]
    Mapping {
        /// Index of the axis.
        axis: usize,
        /// Cause.
        error: PdoMappingError,
    },
    /// The channel sends by CAN ID, not in order: SYNC would overtake its targets, and the end of a
    /// stale target could not be detected.
    #[error(
        "axis {axis}: channel {channel} of slave {slave} sends by CAN ID (Tx queue); axes need \
         the Tx FIFO"
    )]
    TransmitQueue {
        /// Index of the axis.
        axis: usize,
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
    /// The axis is on a channel that only sends or only receives (0x8010:04, 0x8011:04).
    #[error(
        "axis {axis}: channel {channel} of slave {slave} is not in the channel mask of the \
         {direction}; an axis needs both directions"
    )]
    ChannelDirection {
        /// Index of the axis.
        axis: usize,
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// The direction without the channel.
        direction: Direction,
    },
    /// The axis table names a channel that the Port has not enabled.
    #[error("axis {axis} is on channel {channel} of slave {slave}, which is not enabled")]
    ChannelNotEnabled {
        /// Index of the axis.
        axis: usize,
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
}
