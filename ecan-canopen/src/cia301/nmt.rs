//! Network management and error control: NMT, heartbeat and node guarding (CiA 301, 7.2.8).

use core::fmt;

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
            _ => NodeId::from_raw(node).map(|node| Self { command, node: Some(node) }),
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

/// Data of a heartbeat; with [`NmtState::Initialising`] that of the boot-up message.
pub const fn heartbeat_data(state: NmtState) -> [u8; 1] {
    [state.raw()]
}

/// The state that a heartbeat or boot-up message reports. The toggle bit of node guarding, bit 7,
/// is ignored. `None` for what is neither.
pub fn parse_heartbeat(data: &[u8]) -> Option<NmtState> {
    let &[byte] = data else { return None };
    NmtState::from_raw(byte & 0x7F)
}

/// An entry of the consumer heartbeat time, 0x1016.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct HeartbeatConsumer {
    /// Whose heartbeat is watched.
    pub producer: NodeId,
    /// Longest time without it, in milliseconds.
    pub time_ms: u16,
}

impl HeartbeatConsumer {
    /// The value of the entry.
    pub const fn raw(self) -> u32 {
        let [low, high] = self.time_ms.to_le_bytes();
        u32::from_le_bytes([low, high, self.producer.get(), 0])
    }

    /// Reads an entry; `None` for one that is not used.
    pub const fn from_raw(raw: u32) -> Option<Self> {
        let [time_low, time_high, producer, reserved] = raw.to_le_bytes();
        let time_ms = u16::from_le_bytes([time_low, time_high]);
        match NodeId::from_raw(producer) {
            Some(producer) if time_ms > 0 && reserved == 0 => Some(Self { producer, time_ms }),
            _ => None,
        }
    }
}

/// Response of a node to a guarding request, a remote frame with the CAN ID of its heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct GuardResponse {
    /// Alternates from response to response; false in the first one after a reset of communication.
    pub toggle: bool,
    /// NMT state of the node.
    pub state: NmtState,
}

const TOGGLE: u8 = 0x80;

impl GuardResponse {
    /// Bytes of data that a guarding request asks for.
    pub const LENGTH: u8 = 1;

    /// The data of the frame.
    pub const fn to_bytes(self) -> [u8; 1] {
        [self.state.raw() | if self.toggle { TOGGLE } else { 0 }]
    }

    /// Reads the data of a frame; `None` for another length or an undefined state.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[byte] = data else { return None };
        let state = NmtState::from_raw(byte & !TOGGLE)?;
        Some(Self { toggle: byte & TOGGLE != 0, state })
    }
}

/// Error: the number is not a node-ID.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("node-ID {id} is out of range; allowed: 1 to 127")]
pub struct NodeIdError {
    /// The number.
    pub id: u8,
}

/// Node id of a CANopen device, 1 to 127.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(u8);

impl NodeId {
    /// The lowest id.
    pub const MIN: Self = Self(1);
    /// The highest id.
    pub const MAX: Self = Self(127);

    /// The id with this number.
    ///
    /// # Errors
    /// [`NodeIdError`] outside 1 to 127.
    pub const fn new(id: u8) -> Result<Self, NodeIdError> {
        if id >= 1 && id <= 127 { Ok(Self(id)) } else { Err(NodeIdError { id }) }
    }

    /// The id in received data; `None` outside 1 to 127.
    pub const fn from_raw(raw: u8) -> Option<Self> {
        if raw >= 1 && raw <= 127 { Some(Self(raw)) } else { None }
    }

    /// The number.
    pub const fn get(self) -> u8 {
        self.0
    }
}

impl fmt::Display for NodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nmt_bytes_match_cia_301() {
        let node = NodeId::from_raw(5);
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

    #[test]
    fn states_and_boot_up() {
        assert_eq!(parse_heartbeat(&[0]), Some(NmtState::Initialising));
        assert_eq!(parse_heartbeat(&[5]), Some(NmtState::Operational));
        assert_eq!(parse_heartbeat(&[0x7F]), Some(NmtState::PreOperational));
        assert_eq!(parse_heartbeat(&[0x84]), Some(NmtState::Stopped));
        assert_eq!(parse_heartbeat(&[6]), None);
        assert_eq!(parse_heartbeat(&[]), None);
        assert_eq!(heartbeat_data(NmtState::Operational), [5]);
    }

    #[test]
    fn consumer_entries() {
        let producer = NodeId::new(0x7F).unwrap();
        let entry = HeartbeatConsumer { producer, time_ms: 250 };
        assert_eq!(entry.raw(), 0x007F_00FA);
        assert_eq!(HeartbeatConsumer::from_raw(0x007F_00FA), Some(entry));
        for unused in [0, 0x007F_0000, 0x0000_00FA, 0x0080_00FA, 0x017F_00FA] {
            assert_eq!(HeartbeatConsumer::from_raw(unused), None);
        }
    }

    #[test]
    fn response_has_state_and_toggle_bit() {
        for (byte, toggle, state) in [
            (0x05, false, NmtState::Operational),
            (0x85, true, NmtState::Operational),
            (0x04, false, NmtState::Stopped),
            (0xFF, true, NmtState::PreOperational),
        ] {
            let response = GuardResponse { toggle, state };
            assert_eq!(response.to_bytes(), [byte]);
            assert_eq!(GuardResponse::parse(&[byte]), Some(response));
        }
        for wrong in [&[][..], &[0x06], &[0x86], &[5, 5]] {
            assert_eq!(GuardResponse::parse(wrong), None);
        }
    }
}
