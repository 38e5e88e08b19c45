//! Network management (CiA 301, 7.2.8.3).

use core::fmt;

use super::node_id::NodeId;

/// A command of the NMT master.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NmtCommand {
    /// To OPERATIONAL.
    Start,
    /// To STOPPED.
    Stop,
    /// To PRE-OPERATIONAL.
    EnterPreOperational,
    /// Restart of the device.
    ResetNode,
    /// Restart of its communication.
    ResetCommunication,
}

impl NmtCommand {
    /// The command specifier.
    #[must_use]
    pub const fn raw(self) -> u8 {
        match self {
            Self::Start => 0x01,
            Self::Stop => 0x02,
            Self::EnterPreOperational => 0x80,
            Self::ResetNode => 0x81,
            Self::ResetCommunication => 0x82,
        }
    }

    /// The command with this specifier.
    #[must_use]
    pub const fn from_raw(raw: u8) -> Option<Self> {
        Some(match raw {
            0x01 => Self::Start,
            0x02 => Self::Stop,
            0x80 => Self::EnterPreOperational,
            0x81 => Self::ResetNode,
            0x82 => Self::ResetCommunication,
            _ => return None,
        })
    }
}

impl fmt::Display for NmtCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Start => "start",
            Self::Stop => "stop",
            Self::EnterPreOperational => "enter pre-operational",
            Self::ResetNode => "reset node",
            Self::ResetCommunication => "reset communication",
        })
    }
}

/// A command and whom it is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct NmtRequest {
    /// The command.
    pub command: NmtCommand,
    /// The node; `None` for all.
    pub node: Option<NodeId>,
}

impl NmtRequest {
    /// Whether the node has to follow it.
    #[must_use]
    pub fn concerns(&self, node: NodeId) -> bool {
        self.node.is_none_or(|one| one == node)
    }

    /// The data of the frame.
    #[must_use]
    pub const fn to_bytes(self) -> [u8; 2] {
        let node = match self.node {
            Some(node) => node.get(),
            None => 0,
        };
        [self.command.raw(), node]
    }

    /// Reads the data of a frame; `None` for what is no NMT command.
    #[must_use]
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[command, node] = data else { return None };
        let command = NmtCommand::from_raw(command)?;
        match node {
            0 => Some(Self { command, node: None }),
            _ => NodeId::new(node).map(|node| Self { command, node: Some(node) }),
        }
    }
}

/// NMT state of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NmtState {
    /// Booting; the boot-up message reports it.
    Initialising,
    /// Answers NMT and sends heartbeats only.
    Stopped,
    /// Everything runs, PDOs included.
    Operational,
    /// SDO, SYNC, EMCY, no PDOs.
    PreOperational,
}

impl NmtState {
    /// The number in heartbeats.
    #[must_use]
    pub const fn raw(self) -> u8 {
        match self {
            Self::Initialising => 0x00,
            Self::Stopped => 0x04,
            Self::Operational => 0x05,
            Self::PreOperational => 0x7F,
        }
    }

    /// The state with this number.
    #[must_use]
    pub const fn from_raw(raw: u8) -> Option<Self> {
        Some(match raw {
            0x00 => Self::Initialising,
            0x04 => Self::Stopped,
            0x05 => Self::Operational,
            0x7F => Self::PreOperational,
            _ => return None,
        })
    }
}

impl fmt::Display for NmtState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Initialising => "initialising",
            Self::Stopped => "stopped",
            Self::Operational => "operational",
            Self::PreOperational => "pre-operational",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nmt_bytes_match_cia_301() {
        let node = NodeId::new(5);
        let request = NmtRequest { command: NmtCommand::Start, node };
        assert_eq!(request.to_bytes(), [0x01, 0x05]);
        let all = NmtRequest { command: NmtCommand::ResetNode, node: None };
        assert_eq!(all.to_bytes(), [0x81, 0x00]);
        assert_eq!(NmtRequest::parse(&[0x81, 0x00]), Some(all));
        assert!(all.concerns(NodeId::MAX) && request.concerns(node.unwrap()));
        assert!(!request.concerns(NodeId::MAX));
        for wrong in [&[][..], &[1], &[1, 2, 3], &[3, 0], &[1, 128]] {
            assert_eq!(NmtRequest::parse(wrong), None);
        }
    }
}
