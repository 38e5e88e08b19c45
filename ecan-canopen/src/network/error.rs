//! Errors of the network.

use std::fmt;
use std::time::Duration;

use ecan_host::{CycleError, SdoDirection};
use ecan_mcan_port::SendError;
use ecan_protocol::object::AbortCode;
use ecan_protocol::sequence::{SdoValue, StepError};
use thiserror::Error;

use super::config::{GuardingConfig, NodeAddress, Step};
use super::lss::{LssFailure, LssStartError};
use crate::NmtState;

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

/// Cause of the failure of an SDO transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SdoFault {
    /// The node aborted it.
    #[error("aborted by the node: {0}")]
    Aborted(AbortCode),
    /// The host aborted it, because the answer violates the protocol.
    #[error("aborted by the host: {0}")]
    Violated(AbortCode),
    /// No answer arrived in time.
    #[error(
        "no answer after {attempts} attempt{}{}",
        if *attempts == 1 { "" } else { "s" },
        stray.map(|stray| format!("; {stray}")).unwrap_or_default()
    )]
    TimedOut {
        /// Number of attempts.
        attempts: u8,
        /// What the node sent instead, last.
        stray: Option<SdoStray>,
    },
    /// The node sends empty segments and does not end the transfer.
    #[error("the node does not end the transfer: it sends empty segments after {bytes} bytes")]
    Endless {
        /// Bytes received.
        bytes: usize,
    },
    /// The value is longer than the buffer of [`SdoConfig`](crate::SdoConfig).
    #[error("the value does not fit the buffer of {capacity} bytes")]
    TooLong {
        /// Capacity in bytes.
        capacity: usize,
    },
    /// The gateway is no longer ready, and has lost the transfer.
    #[error("the gateway was lost")]
    GatewayLost,
    /// The node restarted: its boot-up message arrived.
    #[error("the node restarted")]
    NodeRestarted,
    /// The application cancelled it.
    #[error("cancelled by the application")]
    Cancelled,
    /// The Port rejected the frame for a reason that waiting does not cure.
    #[error("the frame was rejected: {0}")]
    Rejected(SendError),
}

/// A frame of an SDO server that is no answer to the running transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum SdoStray {
    /// The frame has fewer bytes than its command needs; CiA 301, 7.2.4.3 demands 8.
    #[error("the node sent an answer of {bytes} bytes, 8 are needed")]
    Short {
        /// Length of the frame.
        bytes: usize,
    },
    /// The frame names another object than the running transfer.
    #[error("the node answered for 0x{index:04X}:{subindex:02X}")]
    OtherObject {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
    },
    /// The command of the frame does not follow from the request.
    #[error("the node sent an answer that does not fit the request")]
    Unexpected,
}

impl SdoFault {
    /// Returns whether the same transfer may succeed later without a change by the application.
    pub const fn is_temporary(&self) -> bool {
        matches!(self, Self::TimedOut { .. } | Self::GatewayLost | Self::NodeRestarted)
    }
}

/// Failure of an SDO transfer, with its node and object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("SDO {} 0x{index:04X}:{subindex:02X} {} {address}: {fault}", text(*direction).0, text(*direction).1)]
pub struct SdoFailure {
    /// The node.
    pub address: NodeAddress,
    /// Upload or download.
    pub direction: SdoDirection,
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// Cause.
    pub fault: SdoFault,
}

fn text(direction: SdoDirection) -> (&'static str, &'static str) {
    match direction {
        SdoDirection::Upload => ("upload", "from"),
        SdoDirection::Download => ("download", "to"),
    }
}

/// Rejection of an SDO transfer before its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum SdoStartError {
    /// Another transfer with the node is running.
    #[error("another SDO transfer with the node is running; retry after its end")]
    Busy,
    /// The value is longer than the buffer.
    #[error("{length} bytes do not fit the SDO buffer of {capacity} bytes")]
    TooLong {
        /// Length of the value in bytes.
        length: usize,
        /// Capacity in bytes.
        capacity: usize,
    },
    /// The network has no such node.
    #[error("the network has no such node")]
    UnknownNode,
}

impl SdoStartError {
    /// Returns whether the same call may succeed later without a change by the application.
    pub const fn is_temporary(&self) -> bool {
        matches!(self, Self::Busy)
    }
}

/// Cause of the failure of a step.
pub type StepFault = StepError<NodeAccessError>;

/// Cause of the failure of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NodeAccessError {
    /// The transfer failed.
    #[error(transparent)]
    Sdo(#[from] SdoFault),
    /// The transfer could not start.
    #[error(transparent)]
    Start(#[from] SdoStartError),
    /// The boot-up message did not arrive in time.
    #[error("no boot-up message after {} ms", waited.as_millis())]
    NoBootUp {
        /// Waiting time.
        waited: Duration,
    },
    /// A parameter could not be written or read back.
    #[error("parameter 0x{index:04X}:{subindex:02X}: {fault}")]
    Parameter {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Cause.
        fault: SdoFault,
    },
    /// The node has another value of a parameter than the one that was written.
    #[error("parameter 0x{index:04X}:{subindex:02X} = {expected} was written, {found} read back")]
    ParameterMismatch {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Value that was read back; the first bytes of a long one.
        found: SdoValue,
        /// Value that was written; the first bytes of a long one.
        expected: SdoValue,
    },
    /// Neither heartbeat nor guarding response arrived in time.
    #[error("no heartbeat or guarding response after {} ms", waited.as_millis())]
    NoHeartbeat {
        /// Waiting time.
        waited: Duration,
    },
    /// The node did not report the state in time.
    #[error("after {} ms the node {}", waited.as_millis(), LastState(*reported))]
    State {
        /// State that the node reported last; `None` before its first report.
        reported: Option<NmtState>,
        /// Waiting time.
        waited: Duration,
    },
}

struct LastState(Option<NmtState>);

impl fmt::Display for LastState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(state) => write!(f, "is still in state {state}"),
            None => f.write_str("has not reported a state"),
        }
    }
}

/// Failure of a step, with its node and its position in the list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{address}, step {} of {of}, {step}: {fault}", *nth + 1)]
pub struct StepFailure {
    /// The node.
    pub address: NodeAddress,
    /// Index of the step, from 0.
    pub nth: usize,
    /// Number of steps.
    pub of: usize,
    /// The step.
    pub step: Step,
    /// Cause.
    pub fault: StepFault,
}

impl StepFailure {
    /// Returns whether the same step may succeed later without a change by the application.
    pub const fn is_temporary(&self) -> bool {
        match self.fault {
            StepError::Access(
                NodeAccessError::Sdo(fault) | NodeAccessError::Parameter { fault, .. },
            ) => fault.is_temporary(),
            StepError::Access(NodeAccessError::ParameterMismatch { .. }) => false,
            StepError::Access(NodeAccessError::Start(error)) => error.is_temporary(),
            StepError::Mismatch { .. } => false,
            _ => true,
        }
    }
}
