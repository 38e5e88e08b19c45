//! Network management (CiA 301, 7.2.8.3).

use super::node_id::NodeId;

ecan_protocol::text_enum! {
    /// A command of the NMT master.
    pub enum NmtCommand: u8;
    /// To OPERATIONAL.
    Start = 0x01, "start";
    /// To STOPPED.
    Stop = 0x02, "stop";
    /// To PRE-OPERATIONAL.
    EnterPreOperational = 0x80, "enter pre-operational";
    /// Restart of the device.
    ResetNode = 0x81, "reset node";
    /// Restart of its communication.
    ResetCommunication = 0x82, "reset communication";
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
    /// Returns whether the node has to follow it.
    pub fn concerns(&self, node: NodeId) -> bool {
        self.node.is_none_or(|one| one == node)
    }

    /// The data of the frame.
    pub const fn to_bytes(self) -> [u8; 2] {
        let node = match self.node {
            Some(node) => node.get(),
            None => 0,
        };
        [self.command.raw(), node]
    }

    /// Reads the data of a frame; `None` for what is no NMT command.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[command, node] = data else { return None };
        let command = NmtCommand::from_raw(command)?;
        match node {
            0 => Some(Self { command, node: None }),
            _ => NodeId::new(node).map(|node| Self { command, node: Some(node) }),
        }
    }
}

ecan_protocol::text_enum! {
    /// NMT state of a node.
    pub enum NmtState: u8;
    /// Booting; the boot-up message reports it.
    Initialising = 0x00, "initialising";
    /// Answers NMT and sends heartbeats only.
    Stopped = 0x04, "stopped";
    /// Everything runs, PDOs included.
    Operational = 0x05, "operational";
    /// SDO, SYNC, EMCY, no PDOs.
    PreOperational = 0x7F, "pre-operational";
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
