//! Set of the CAN IDs that a drive receives.

use ecan_canopen::{CobId, NodeId};
use ecan_protocol::can::CanId;

const WORD_BITS: usize = 64;
const STANDARD_IDS: usize = 1 << 11;

/// A set of CAN IDs. Every frame on the bus is looked up in it.
#[derive(Clone, Debug)]
pub(super) struct CanIdSet {
    standard: [u64; STANDARD_IDS / WORD_BITS],
    extended: Vec<CanId>,
}

impl CanIdSet {
    pub(super) const fn new() -> Self {
        Self { standard: [0; STANDARD_IDS / WORD_BITS], extended: Vec::new() }
    }

    /// CAN IDs of the services that every drive has: NMT, LSS, its SDO server, heartbeats of other nodes,
    /// and its guarding requests.
    pub(super) fn services_of(node: NodeId) -> Self {
        let mut services = Self::new();
        services.insert(CobId::NMT.can_id());
        services.insert(CobId::LSS_REQUEST.can_id());
        services.insert(CobId::sdo_client(node).can_id());
        for producer in (1..=127).filter_map(NodeId::new) {
            services.insert(CobId::heartbeat(producer).can_id());
        }
        services
    }

    pub(super) fn insert(&mut self, id: CanId) {
        let (word, bit) = bit_position(id);
        if id.is_extended() {
            self.extended.push(id);
        } else if let Some(bits) = self.standard.get_mut(word) {
            *bits |= 1 << bit;
        }
    }

    pub(super) fn contains(&self, id: CanId) -> bool {
        if id.is_extended() {
            return self.extended.contains(&id);
        }
        let (word, bit) = bit_position(id);
        self.standard.get(word).is_some_and(|bits| bits >> bit & 1 == 1)
    }

    pub(super) fn reset(&mut self, services: &Self) {
        self.standard = services.standard;
        self.extended.clear();
    }
}

fn bit_position(id: CanId) -> (usize, usize) {
    let raw = id.raw() as usize;
    (raw / WORD_BITS, raw % WORD_BITS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_contains_both_formats() {
        let node = NodeId::new(5).unwrap();
        let standard = |raw| CanId::standard(raw).unwrap();
        let services = CanIdSet::services_of(node);
        for (raw, is_in) in [(0, true), (0x605, true), (0x606, false), (0x700, false)] {
            assert_eq!(services.contains(standard(raw)), is_in, "{raw:#X}");
        }
        assert!(services.contains(standard(0x701)) && services.contains(standard(0x77F)));
        let extended = CanId::extended(0x205).unwrap();
        let mut all = CanIdSet::new();
        all.insert(extended);
        assert!(all.contains(extended) && !all.contains(standard(0x205)));
        all.insert(standard(0x205));
        all.reset(&services);
        assert!(!all.contains(extended) && !all.contains(standard(0x205)));
        assert!(all.contains(standard(0x605)));
    }
}
