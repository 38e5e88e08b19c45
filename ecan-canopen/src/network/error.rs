//! What can go wrong, located and in words.

use ecan_host::{CycleError, SdoDirection};
use ecan_mcan_port::SendError;
use ecan_protocol::object::AbortCode;
use thiserror::Error;

use super::address::NodeAddress;

/// Why an SDO transfer failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SdoFault {
    /// The node aborted it.
    #[error("aborted by the node: {0}")]
    Aborted(AbortCode),
    /// The host aborted it, because of what the node answered.
    #[error("aborted by the host: {0}")]
    Violated(AbortCode),
    /// No answer came in time.
    #[error("no answer after {attempts} attempt{}", if *attempts == 1 { "" } else { "s" })]
    TimedOut {
        /// How often it was tried.
        attempts: u8,
    },
    /// The value is longer than the buffer of [`SdoConfig`](crate::SdoConfig).
    #[error("the value does not fit the buffer of {capacity} bytes")]
    TooLong {
        /// Bytes that fit.
        capacity: usize,
    },
    /// The gateway went out of service: what it knew of the transfer is gone.
    #[error("the gateway went out of service")]
    GatewayLost,
    /// The node restarted: its boot-up message came.
    #[error("the node restarted")]
    NodeRestarted,
    /// The application gave it up.
    #[error("given up by the application")]
    Cancelled,
    /// The Port refused the frame for a reason that waiting does not cure.
    #[error("the frame was refused: {0}")]
    Refused(SendError),
}

/// An SDO transfer that failed, with everything that locates it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("SDO {} 0x{index:04X}:{subindex:02X} {} {address}: {fault}", words(*direction).0, words(*direction).1)]
pub struct SdoFailure {
    /// The node.
    pub address: NodeAddress,
    /// Up- or download.
    pub direction: SdoDirection,
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// Why.
    pub fault: SdoFault,
}

fn words(direction: SdoDirection) -> (&'static str, &'static str) {
    match direction {
        SdoDirection::Upload => ("upload", "from"),
        SdoDirection::Download => ("download", "to"),
    }
}

/// Why an SDO transfer cannot start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum SdoStartError {
    /// Another transfer with the node is under way.
    #[error("an SDO transfer with the node is under way")]
    Busy,
    /// The value is longer than the buffer.
    #[error("{length} bytes do not fit the SDO buffer of {capacity} bytes")]
    TooLong {
        /// Bytes given.
        length: usize,
        /// Bytes that fit.
        capacity: usize,
    },
    /// The network has no such node.
    #[error("the network has no such node")]
    UnknownNode,
}

/// Why a node cannot be added, or a setting cannot be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// A gateway has four channels.
    #[error("{address}: a gateway has channels 0 to 3 only")]
    Channel {
        /// The node.
        address: NodeAddress,
    },
    /// The node is there already.
    #[error("{address} is in the network already")]
    Duplicate {
        /// The node.
        address: NodeAddress,
    },
    /// The host itself uses this node-ID for its heartbeat.
    #[error("{address} has the node-ID of the host's own heartbeat")]
    HostNode {
        /// The node.
        address: NodeAddress,
    },
    /// A network holds 65535 nodes.
    #[error("no more nodes fit")]
    TooMany,
    /// The SYNC counter overflow is not 2..240.
    #[error("SYNC counter overflow {value} is not in 2..240")]
    CounterOverflow {
        /// The value given.
        value: u8,
    },
}

/// Why an NMT command was not queued.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum NmtError {
    /// So many commands wait for the channel that no more fit.
    #[error("slave {slave} channel {channel}: no more NMT commands can wait")]
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

/// Why a blocking call ended without success.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum WaitError {
    /// The transfer failed.
    #[error(transparent)]
    Sdo(#[from] SdoFailure),
    /// The transfer could not start.
    #[error(transparent)]
    Start(#[from] SdoStartError),
    /// The command could not be queued.
    #[error(transparent)]
    Nmt(#[from] NmtError),
    /// A step of a configuration failed.
    #[error(transparent)]
    Step(#[from] super::step_failure::StepFailure),
    /// It did not end in time.
    #[error("not done after {waited_ms} ms")]
    TimedOut {
        /// How long was waited, in milliseconds of the bus clock.
        waited_ms: u64,
    },
    /// The application gave up waiting
    /// ([`Adapter::stop_waiting_when`](ecan_host::Adapter::stop_waiting_when)).
    #[error("given up by the application")]
    Stopped,
    /// The cycle failed.
    #[error(transparent)]
    Cycle(#[from] CycleError),
}
