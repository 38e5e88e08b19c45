//! Errors of SDO transfers.

use ecan_host::SdoDirection;
use ecan_mcan_port::SendError;
use ecan_protocol::object::AbortCode;
use thiserror::Error;

use super::address::NodeAddress;

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
    #[error("no answer after {attempts} attempt{}", if *attempts == 1 { "" } else { "s" })]
    TimedOut {
        /// Number of attempts.
        attempts: u8,
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
