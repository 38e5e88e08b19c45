//! Errors of LSS commands.

use std::time::Duration;

use ecan_mcan_port::SendError;
use thiserror::Error;

use super::command::LssCommand;
use crate::{LssBitRate, LssPart, NodeId};

/// Cause of the failure of an LSS command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LssFault {
    /// No slave responded in time.
    #[error(
        "no slave responded after {} ms; switch the slave to the configuration state first",
        waited.as_millis()
    )]
    TimedOut {
        /// Waiting time.
        waited: Duration,
    },
    /// No slave has the address of a selective switch.
    #[error(
        "no slave with this address responded after {} ms; check the address, and that the slave is in the waiting \
         state",
        waited.as_millis()
    )]
    NotSelected {
        /// Waiting time.
        waited: Duration,
    },
    /// The slave rejected the node-ID.
    #[error("the slave rejected node-ID {}", node.map_or(255, NodeId::get))]
    NodeIdRejected {
        /// Node-ID; `None` is 255, no node-ID.
        node: Option<NodeId>,
    },
    /// The slave does not support the bit rate.
    #[error("the slave does not support {bit_rate}")]
    BitRateRejected {
        /// Bit rate.
        bit_rate: LssBitRate,
    },
    /// The slave cannot store its configuration.
    #[error("the slave does not support storing; configure it after each power-on")]
    StoreNotSupported,
    /// The slave could not access its storage.
    #[error("the slave could not access its storage")]
    StoreFailed,
    /// The slave reported an error of its manufacturer.
    #[error("the slave reported manufacturer-specific error {code}; see its manual")]
    Manufacturer {
        /// The code.
        code: u8,
    },
    /// The slave reported an error that CiA 305 does not define.
    #[error("the slave reported error {code}, which CiA 305 does not define")]
    Undefined {
        /// The code.
        code: u8,
    },
    /// The slave reported a node-ID that CiA 301 does not allow.
    #[error("the slave reported node-ID {node}; allowed: 1 to 127, or 255 for none")]
    InvalidNodeId {
        /// The number.
        node: u8,
    },
    /// The result of a fastscan matches no slave: a response was lost or late.
    #[error(
        "the scanned {part} matches no slave: a response was lost or late; scan again, with a longer scan_time"
    )]
    Inconsistent {
        /// Part of the address.
        part: LssPart,
    },
    /// The gateway is no longer ready.
    #[error("the gateway was lost")]
    GatewayLost,
    /// The application cancelled the command.
    #[error("cancelled by the application")]
    Cancelled,
    /// The Port rejected the frame for a permanent reason.
    #[error("the frame was rejected: {0}")]
    Rejected(SendError),
}

impl LssFault {
    /// Returns whether the same command may succeed later without a change by the application.
    pub const fn is_temporary(&self) -> bool {
        matches!(self, Self::GatewayLost | Self::Inconsistent { .. } | Self::TimedOut { .. })
    }
}

/// Failure of an LSS command, with its channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("LSS on slave {slave} channel {channel}, {command}: {fault}")]
pub struct LssFailure {
    /// Slave index of the gateway.
    pub slave: usize,
    /// Channel.
    pub channel: u8,
    /// The command.
    pub command: LssCommand,
    /// Cause.
    pub fault: LssFault,
}

/// Rejection of an LSS command before its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum LssStartError {
    /// Another command is running on the channel.
    #[error("slave {slave} channel {channel}: another LSS command is running; retry after its end")]
    Busy {
        /// Slave index of the gateway.
        slave: usize,
        /// Channel.
        channel: u8,
    },
    /// The network does not have the channel.
    #[error(
        "slave {slave} channel {channel} is not in the network; add a node or call add_channel"
    )]
    UnknownChannel {
        /// Slave index of the gateway.
        slave: usize,
        /// Channel.
        channel: u8,
    },
}

impl LssStartError {
    /// Returns whether the same call may succeed later without a change by the application.
    pub const fn is_temporary(&self) -> bool {
        matches!(self, Self::Busy { .. })
    }
}
