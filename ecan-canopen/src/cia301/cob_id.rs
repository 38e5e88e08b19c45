//! The predefined connection set (CiA 301, 7.3.3): which identifier carries what.

use ecan_protocol::can::CanId;

use super::nmt::NodeId;

/// An 11-bit identifier of the predefined connection set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CobId(u16);

/// Content of a COB-ID of the predefined connection set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Service {
    /// NMT command, to all nodes.
    Nmt,
    /// SYNC, to all nodes.
    Sync,
    /// TIME, to all nodes.
    Time,
    /// Emergency of a node.
    Emcy(NodeId),
    /// Process data that a node sends, 1 to 4.
    Tpdo(NodeId, u8),
    /// Process data that a node receives, 1 to 4.
    Rpdo(NodeId, u8),
    /// SDO answer of a node.
    SdoServer(NodeId),
    /// SDO request to a node.
    SdoClient(NodeId),
    /// Boot-up, heartbeat and node guarding of a node.
    Heartbeat(NodeId),
    /// Response of an LSS slave (CiA 305).
    LssResponse,
    /// Request of the LSS master (CiA 305).
    LssRequest,
}

const FIRST_TPDO: u16 = 0x180;
const FIRST_RPDO: u16 = 0x200;

impl CobId {
    /// NMT command.
    pub const NMT: Self = Self(0x000);
    /// SYNC.
    pub const SYNC: Self = Self(0x080);
    /// TIME.
    pub const TIME: Self = Self(0x100);
    /// Response of an LSS slave (CiA 305).
    pub const LSS_RESPONSE: Self = Self(0x7E4);
    /// Request of the LSS master (CiA 305).
    pub const LSS_REQUEST: Self = Self(0x7E5);

    /// Emergency of a node.
    pub const fn emcy(node: NodeId) -> Self {
        Self(0x080 + node.get() as u16)
    }

    /// Process data sent by a node; `number` 1 to 4, above that counted as 4.
    pub const fn tpdo(node: NodeId, number: u8) -> Self {
        Self::pdo(FIRST_TPDO, node, number)
    }

    /// Process data received by a node; `number` 1 to 4, above that counted as 4.
    pub const fn rpdo(node: NodeId, number: u8) -> Self {
        Self::pdo(FIRST_RPDO, node, number)
    }

    const fn pdo(first: u16, node: NodeId, number: u8) -> Self {
        let nth = if number > 4 { 3 } else { number.saturating_sub(1) };
        Self(first + nth as u16 * 0x100 + node.get() as u16)
    }

    /// SDO request to a node.
    pub const fn sdo_client(node: NodeId) -> Self {
        Self(0x600 + node.get() as u16)
    }

    /// SDO answer of a node.
    pub const fn sdo_server(node: NodeId) -> Self {
        Self(0x580 + node.get() as u16)
    }

    /// Boot-up and heartbeat of a node.
    pub const fn heartbeat(node: NodeId) -> Self {
        Self(0x700 + node.get() as u16)
    }

    /// The number.
    pub const fn raw(self) -> u16 {
        self.0
    }

    /// The identifier for a frame.
    pub fn can_id(self) -> CanId {
        CanId::standard(self.0).unwrap_or_else(|_| {
            // infallible: every constructor stays below 0x800
            unreachable!()
        })
    }

    /// The content of a COB-ID, by the predefined connection set; `None` for an extended
    /// identifier and for one that the set leaves free.
    pub fn classify(id: CanId) -> Option<Service> {
        if id.is_extended() {
            return None;
        }
        let raw = id.raw();
        let function = raw & 0x780;
        let Some(node) = NodeId::from_raw((raw & 0x7F) as u8) else {
            return match raw {
                0x000 => Some(Service::Nmt),
                0x080 => Some(Service::Sync),
                0x100 => Some(Service::Time),
                _ => None,
            };
        };
        Some(match function {
            0x080 => Service::Emcy(node),
            0x180 | 0x280 | 0x380 | 0x480 => Service::Tpdo(node, (function >> 8) as u8),
            0x200 | 0x300 | 0x400 | 0x500 => Service::Rpdo(node, (function >> 8) as u8 - 1),
            0x580 => Service::SdoServer(node),
            0x600 => Service::SdoClient(node),
            0x700 => Service::Heartbeat(node),
            0x780 if raw == 0x7E4 => Service::LssResponse,
            0x780 if raw == 0x7E5 => Service::LssRequest,
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_and_services_belong_together() {
        let is = |cob_id: CobId, service| {
            assert_eq!(CobId::classify(cob_id.can_id()), Some(service));
        };
        is(CobId::NMT, Service::Nmt);
        is(CobId::SYNC, Service::Sync);
        is(CobId::TIME, Service::Time);
        is(CobId::LSS_RESPONSE, Service::LssResponse);
        is(CobId::LSS_REQUEST, Service::LssRequest);
        for node in (1..=127).filter_map(NodeId::from_raw) {
            is(CobId::emcy(node), Service::Emcy(node));
            is(CobId::sdo_client(node), Service::SdoClient(node));
            is(CobId::sdo_server(node), Service::SdoServer(node));
            is(CobId::heartbeat(node), Service::Heartbeat(node));
            for number in 1..=4 {
                is(CobId::tpdo(node, number), Service::Tpdo(node, number));
                is(CobId::rpdo(node, number), Service::Rpdo(node, number));
            }
        }
    }

    #[test]
    fn predefined_set_has_its_numbers() {
        let node = NodeId::new(5).unwrap();
        assert_eq!(CobId::tpdo(node, 1).raw(), 0x185);
        assert_eq!(CobId::rpdo(node, 1).raw(), 0x205);
        assert_eq!(CobId::tpdo(node, 4).raw(), 0x485);
        assert_eq!(CobId::sdo_client(node).raw(), 0x605);
        assert_eq!(CobId::sdo_server(node).raw(), 0x585);
        assert_eq!(CobId::heartbeat(node).raw(), 0x705);
        assert_eq!(CobId::emcy(node).raw(), 0x085);
        assert_eq!(CobId::classify(CanId::standard(0x680).unwrap()), None);
        assert_eq!(CobId::classify(CanId::extended(0x185).unwrap()), None);
    }
}
