//! What can go wrong with axes, located and in words.

use std::fmt;
use std::time::Duration;

use ecan_canopen::{NetworkError, NmtError, WaitError};
use ecan_mcan_port::NotSchedulable;
use thiserror::Error;

use crate::axis::command_error::CommandError;
use crate::axis::config::AxisFault;
use crate::axis::phase::AxisProgress;

/// Why targets or SYNC cannot be scheduled at a phase of Sync0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ScheduleError {
    /// The configuration or a gateway cannot serve it.
    #[error("slave {slave} cannot schedule at {offset_ns} ns: {reason}")]
    NotSchedulable {
        /// Slave index.
        slave: usize,
        /// The offset given.
        offset_ns: u32,
        /// Why not.
        reason: NotSchedulable,
    },
    /// An axis is taken up: a target at once would overtake one that is still scheduled.
    #[error("axis {axis} is taken up: disable it first")]
    Active {
        /// Index of the axis.
        axis: usize,
    },
    /// SYNC would go out before the targets that it is to make effective.
    #[error("SYNC at {sync_offset_ns} ns would go out before the targets at {target_offset_ns} ns")]
    SyncFirst {
        /// Phase of the targets.
        target_offset_ns: u32,
        /// Phase of SYNC.
        sync_offset_ns: u32,
    },
}

/// Everything that is wrong with an axis table.
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

/// Axes that did not get where they were to be.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisTimeout {
    /// What was waited for.
    pub what: &'static str,
    /// Waiting time by the bus clock.
    pub waited: Duration,
    /// The axes that lack, with what each is doing and what hinders it.
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
    /// The axis table has faults; nothing was touched.
    #[error(transparent)]
    Axes(#[from] AxisFaults),
    /// The network cannot be set up so.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A command was not taken.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// An NMT command could not be queued.
    #[error(transparent)]
    Nmt(#[from] NmtError),
    /// Axes did not get where they were to be.
    #[error(transparent)]
    AxisTimeout(#[from] AxisTimeout),
    /// The cycle failed while waiting.
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// The axis table names a gateway that the Port does not have.
    #[error("axis {axis} is behind slave {slave}, the Port has {slaves}")]
    NoSuchSlave {
        /// Index of the axis.
        axis: usize,
        /// The slave index given.
        slave: usize,
        /// Gateways of the Port.
        slaves: usize,
    },
    /// The channel sends by identifier, not in order: SYNC would overtake its targets, and nobody
    /// could tell when a stale target is gone.
    #[error(
        "axis {axis}: channel {channel} of slave {slave} sends by identifier (Tx queue), axes need \
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
