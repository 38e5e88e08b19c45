//! Errors of the network.

use std::time::Duration;

use ecan_host::CycleError;
use thiserror::Error;

use super::address::NodeAddress;
use super::sdo_error::{SdoFailure, SdoStartError};
use super::step_failure::StepFailure;

/// Rejection of a node or of a configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// A gateway has four channels.
    #[error("{address}: invalid channel; allowed: 0 to 3")]
    Channel {
        /// The node.
        address: NodeAddress,
    },
    /// The node exists already.
    #[error("{address} is in the network already")]
    Duplicate {
        /// The node.
        address: NodeAddress,
    },
    /// The host uses this node-ID for its heartbeat.
    #[error("{address} has the node-ID of the host's heartbeat")]
    HostNode {
        /// The node.
        address: NodeAddress,
    },
    /// A network holds 65535 nodes.
    #[error("too many nodes; allowed: 65535")]
    TooMany,
    /// The SYNC counter overflow is out of range.
    #[error("SYNC counter overflow {value} is out of range; allowed: 2 to 240")]
    CounterOverflow {
        /// The invalid value.
        value: u8,
    },
}

/// Rejection of an NMT command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum NmtError {
    /// The queue of the channel is full.
    #[error("slave {slave} channel {channel}: NMT command queue is full; retry in a later cycle")]
    QueueFull {
        /// Slave index.
        slave: usize,
        /// Channel.
        channel: u8,
    },
    /// The network has no such node.
    #[error("the network has no such node")]
    UnknownNode,
}

impl NmtError {
    /// Returns whether the same call may succeed later without a change by the application.
    pub const fn is_temporary(&self) -> bool {
        matches!(self, Self::QueueFull { .. })
    }
}

/// Failure of a blocking call.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum WaitError {
    /// The transfer failed.
    #[error(transparent)]
    Sdo(#[from] SdoFailure),
    /// The transfer could not start.
    #[error(transparent)]
    Start(#[from] SdoStartError),
    /// A step of a configuration failed.
    #[error(transparent)]
    Step(Box<StepFailure>),
    /// It did not end in time.
    #[error("not done after {} ms", waited.as_millis())]
    TimedOut {
        /// Waiting time by the bus clock.
        waited: Duration,
    },
    /// The application cancelled waiting
    /// ([`Adapter::stop_waiting_when`](ecan_host::Adapter::stop_waiting_when)).
    #[error("cancelled by the application")]
    Stopped,
    /// The cycle failed.
    #[error(transparent)]
    Cycle(#[from] CycleError),
}

impl From<StepFailure> for WaitError {
    fn from(failure: StepFailure) -> Self {
        Self::Step(Box::new(failure))
    }
}

impl WaitError {
    /// Returns whether the same call may succeed later without a change by the application.
    pub fn is_temporary(&self) -> bool {
        match self {
            Self::Sdo(failure) => failure.fault.is_temporary(),
            Self::Start(error) => error.is_temporary(),
            Self::Step(failure) => failure.is_temporary(),
            Self::TimedOut { .. } => true,
            Self::Stopped => false,
            Self::Cycle(error) => error.is_temporary(),
        }
    }
}
