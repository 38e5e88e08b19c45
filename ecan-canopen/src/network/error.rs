//! Errors of the network.

use std::time::Duration;

use ecan_host::CycleError;
use thiserror::Error;

use super::address::NodeAddress;
use super::guarding_config::GuardingConfig;
use super::lss::{LssFailure, LssStartError};
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
    /// A gateway has four channels.
    #[error("slave {slave}: invalid channel {channel}; allowed: 0 to 3")]
    NoChannel {
        /// Slave index.
        slave: usize,
        /// The invalid channel.
        channel: u8,
    },
    /// The guarding configuration is out of range.
    #[error(
        "{address}: guard time {} us with life time factor {} is out of range; allowed: 1 ms to 65535 ms in whole \
         milliseconds, factor 1 to 255",
        guarding.guard_time.as_micros(),
        guarding.life_time_factor
    )]
    Guarding {
        /// The node.
        address: NodeAddress,
        /// The invalid configuration.
        guarding: GuardingConfig,
    },
    /// A node is watched by its heartbeat or by guarding.
    #[error(
        "{address} has a heartbeat timeout and guarding; allowed: one of them; set heartbeat_timeout to 0 or \
         guarding to None"
    )]
    HeartbeatAndGuarding {
        /// The node.
        address: NodeAddress,
    },
    /// TIME cannot express the Unix time.
    #[error(
        "Unix time {unix_ns} ns is out of range for TIME; allowed: 1984-01-01 to 2163-06-06; set the clock"
    )]
    TimeReference {
        /// The invalid time in nanoseconds.
        unix_ns: u64,
    },
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
    /// The network does not have the channel.
    #[error(
        "slave {slave} channel {channel} is not in the network; add a node or call add_channel"
    )]
    UnknownChannel {
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
    /// The LSS command failed.
    #[error(transparent)]
    Lss(#[from] LssFailure),
    /// The LSS command could not start.
    #[error(transparent)]
    LssStart(#[from] LssStartError),
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
            Self::Lss(failure) => failure.fault.is_temporary(),
            Self::LssStart(error) => error.is_temporary(),
            Self::Step(failure) => failure.is_temporary(),
            Self::TimedOut { .. } => true,
            Self::Stopped => false,
            Self::Cycle(error) => error.is_temporary(),
        }
    }
}
