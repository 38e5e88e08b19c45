//! Which axis a TPDO belongs to.

use ecan_canopen::{CobId, NodeAddress, NodeId, Service};
use ecan_protocol::can::CanId;
use ecan_protocol::mapping::CHANNELS;

/// Node-IDs, 0 included.
const NODE_IDS: usize = 128;

type Nodes = [Option<(u16, u8)>; NODE_IDS];

/// Axis and PDO number by slave, channel and node-ID.
#[derive(Debug)]
pub(super) struct AxisLookup {
    slaves: Vec<[Nodes; CHANNELS]>,
}

impl AxisLookup {
    pub(super) fn new(slaves: usize) -> Self {
        Self { slaves: vec![[[None; NODE_IDS]; CHANNELS]; slaves] }
    }

    pub(super) fn insert(&mut self, address: NodeAddress, pdo_number: u8, axis: u16) {
        let slot = self
            .slaves
            .get_mut(address.slave)
            .and_then(|channels| channels.get_mut(usize::from(address.channel)))
            .and_then(|nodes| nodes.get_mut(usize::from(address.node.get())));
        if let Some(slot) = slot {
            *slot = Some((axis, pdo_number));
        }
    }

    pub(super) fn tpdo(&self, slave: usize, channel: u8, id: CanId) -> Option<usize> {
        let Some(Service::Tpdo(node, number)) = CobId::classify(id) else { return None };
        let (axis, pdo_number) = self.find(slave, channel, node)?;
        (pdo_number == number).then_some(usize::from(axis))
    }

    fn find(&self, slave: usize, channel: u8, node: NodeId) -> Option<(u16, u8)> {
        let nodes = self.slaves.get(slave)?.get(usize::from(channel))?;
        nodes.get(usize::from(node.get())).copied().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_mapped_tpdo_of_a_known_node_is_found() {
        let node = NodeId::new(5).unwrap();
        let mut lookup = AxisLookup::new(2);
        lookup.insert(NodeAddress { slave: 1, channel: 3, node }, 2, 7);
        let id = |raw| CanId::standard(raw).unwrap();
        assert_eq!(lookup.tpdo(1, 3, id(0x285)), Some(7));
        for (slave, channel, raw) in [
            (1, 3, 0x185),
            (1, 3, 0x305),
            (1, 3, 0x286),
            (0, 3, 0x285),
            (1, 2, 0x285),
            (9, 3, 0x285),
        ] {
            assert_eq!(lookup.tpdo(slave, channel, id(raw)), None);
        }
        assert_eq!(lookup.tpdo(1, 3, CanId::extended(0x285).unwrap()), None);
    }
}
