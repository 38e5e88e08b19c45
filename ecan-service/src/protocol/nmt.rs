//! Method `nmt`.

use serde::{Deserialize, Serialize};

/// NMT command (CiA 301).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NmtCommand {
    /// To Operational.
    Start,
    /// To Stopped.
    Stop,
    /// To Pre-operational.
    EnterPreOperational,
    /// Restarts the application of the node.
    ResetNode,
    /// Restarts the communication of the node.
    ResetCommunication,
}

impl NmtCommand {
    /// Command specifier in the frame.
    pub const fn specifier(self) -> u8 {
        match self {
            Self::Start => 1,
            Self::Stop => 2,
            Self::EnterPreOperational => 128,
            Self::ResetNode => 129,
            Self::ResetCommunication => 130,
        }
    }
}

/// Parameters of `nmt`. The response reports that the frame is queued.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NmtParams {
    /// Index of the gateway.
    pub gateway: u16,
    /// Channel, 0 to 3.
    pub channel: u8,
    /// Node-ID, 1 to 127; 0 for all nodes.
    pub node: u8,
    /// Command.
    pub command: NmtCommand,
}
