//! Which axis a TPDO belongs to.

use ecan_canopen::{CobId, NodeAddress, Service};
use ecan_protocol::can::CanId;
use ecan_protocol::mapping::CHANNELS;

use crate::axis::config::LAST_PDO;

/// Node-IDs, 0 included.
const NODE_IDS: usize = 128;

/// By the number of the TPDO: the axis, and which of its TPDOs it is.
type Tpdos = [Option<(u16, u8)>; LAST_PDO as usize];
type Nodes = [Tpdos; NODE_IDS];

/// Axis of a TPDO by slave, channel, node-ID and PDO number.
#[derive(Debug)]
pub(super) struct AxisLookup {
    slaves: Vec<[Nodes; CHANNELS]>,
}

impl AxisLookup {
    pub(super) fn new(slaves: usize) -> Self {
        Self { slaves: vec![[[[None; LAST_PDO as usize]; NODE_IDS]; CHANNELS]; slaves] }
    }

    /// Adds the `count` TPDOs of an axis from a number on.
    pub(super) fn insert(&mut self, address: NodeAddress, first: u8, count: usize, axis: u16) {
        let slot = self
            .slaves
            .get_mut(address.slave)
            .and_then(|channels| channels.get_mut(usize::from(address.channel)))
            .and_then(|nodes| nodes.get_mut(usize::from(address.node.get())));
        let first = usize::from(first.saturating_sub(1));
        let slots = slot.into_iter().flatten().skip(first).take(count);
        for (nth, slot) in (0..).zip(slots) {
            *slot = Some((axis, nth));
        }
    }

    /// The axis of a TPDO, and which of its TPDOs it is.
    pub(super) fn tpdo(&self, slave: usize, channel: u8, id: CanId) -> Option<(usize, usize)> {
        let Some(Service::Tpdo(node, number)) = CobId::classify(id) else { return None };
        let nodes = self.slaves.get(slave)?.get(usize::from(channel))?;
        let tpdos = nodes.get(usize::from(node.get()))?;
        let (axis, nth) = (*tpdos.get(usize::from(number.checked_sub(1)?))?)?;
        Some((usize::from(axis), usize::from(nth)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::NodeId;

    #[test]
    fn only_mapped_tpdos_of_a_known_node_are_found() {
        let node = NodeId::new(5).unwrap();
        let mut lookup = AxisLookup::new(2);
        lookup.insert(NodeAddress { slave: 1, channel: 3, node }, 2, 2, 7);
        let id = |raw| CanId::standard(raw).unwrap();
        assert_eq!(lookup.tpdo(1, 3, id(0x285)), Some((7, 0)));
        assert_eq!(lookup.tpdo(1, 3, id(0x385)), Some((7, 1)));
        for (slave, channel, raw) in [
            (1, 3, 0x185),
            (1, 3, 0x305),
            (1, 3, 0x485),
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
