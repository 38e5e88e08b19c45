//! Boot-up and heartbeat (CiA 301, 7.2.8.3.2).

use super::nmt::NmtState;
use super::node_id::NodeId;

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
        (self.producer.get() as u32) << 16 | self.time_ms as u32
    }

    /// Reads an entry; `None` for one that is not used.
    pub const fn from_raw(raw: u32) -> Option<Self> {
        let [time_low, time_high, producer, reserved] = raw.to_le_bytes();
        let time_ms = u16::from_le_bytes([time_low, time_high]);
        match NodeId::new(producer) {
            Some(producer) if time_ms > 0 && reserved == 0 => Some(Self { producer, time_ms }),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
