//! Which axis a TPDO belongs to.

use ecan_canopen::NodeAddress;
use ecan_protocol::can::CanId;
use ecan_protocol::mapping::CHANNELS;

/// CAN IDs of 11 bits.
const CAN_IDS: usize = 0x800;

/// By CAN ID: the axis, and which of its TPDOs it is.
type Tpdos = Vec<Option<(u16, u8)>>;

/// Axis of a TPDO by slave, channel and CAN ID. A channel without axes has no entries.
#[derive(Debug)]
pub(super) struct AxisLookup {
    slaves: Vec<[Tpdos; CHANNELS]>,
}

impl AxisLookup {
    pub(super) fn new(slaves: usize) -> Self {
        Self { slaves: (0..slaves).map(|_| Default::default()).collect() }
    }

    /// Adds the TPDOs of an axis in their order.
    pub(super) fn insert(
        &mut self,
        address: NodeAddress,
        ids: impl Iterator<Item = CanId>,
        axis: u16,
    ) {
        let channels = self.slaves.get_mut(address.slave);
        let tpdos = channels.and_then(|of_slave| of_slave.get_mut(usize::from(address.channel)));
        let Some(tpdos) = tpdos else { return };
        tpdos.resize(CAN_IDS, None);
        for (nth, id) in (0..).zip(ids) {
            if let Some(slot) = tpdos.get_mut(id.raw() as usize) {
                *slot = Some((axis, nth));
            }
        }
    }

    /// The axis of a TPDO, and which of its TPDOs it is.
    pub(super) fn tpdo(&self, slave: usize, channel: u8, id: CanId) -> Option<(usize, usize)> {
        if id.is_extended() {
            return None;
        }
        let tpdos = self.slaves.get(slave)?.get(usize::from(channel))?;
        let (axis, nth) = (*tpdos.get(id.raw() as usize)?)?;
        Some((usize::from(axis), usize::from(nth)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::NodeId;

    #[test]
    fn only_mapped_tpdos_are_found() {
        let node = NodeId::new(5).unwrap();
        let id = |raw| CanId::standard(raw).unwrap();
        let mut lookup = AxisLookup::new(2);
        let address = NodeAddress { slave: 1, channel: 3, node };
        lookup.insert(address, [id(0x285), id(0x385)].into_iter(), 7);
        lookup.insert(address, [id(0x1A0)].into_iter(), 8);
        assert_eq!(lookup.tpdo(1, 3, id(0x285)), Some((7, 0)));
        assert_eq!(lookup.tpdo(1, 3, id(0x385)), Some((7, 1)));
        assert_eq!(lookup.tpdo(1, 3, id(0x1A0)), Some((8, 0)));
        for (slave, channel, raw) in [
            (1, 3, 0x185),
            (1, 3, 0x305),
            (1, 3, 0x7FF),
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
