//! Set of the CAN IDs that a drive receives.

use ecan_canopen::{CobId, NodeId};
use ecan_protocol::can::CanId;

use super::standard_ids::StandardIds;

/// A set of CAN IDs. Every frame on the bus is looked up in it.
#[derive(Clone, Debug, Default)]
pub(super) struct CanIdSet {
    pub(super) standard: StandardIds,
    extended: Vec<CanId>,
    version: u32,
}

impl CanIdSet {
    /// CAN IDs of the services that every drive has: NMT, LSS, its SDO server, heartbeats of other nodes,
    /// and its guarding requests.
    pub(super) fn services_of(node: NodeId) -> Self {
        let mut services = Self::default();
        services.insert(CobId::NMT.can_id());
        services.insert(CobId::LSS_REQUEST.can_id());
        services.insert(CobId::sdo_client(node).can_id());
        for producer in (1..=127).filter_map(NodeId::new) {
            services.insert(CobId::heartbeat(producer).can_id());
        }
        services
    }

    /// Changes with every change of the set; 0 at first.
    pub(super) const fn version(&self) -> u32 {
        self.version
    }

    pub(super) fn insert(&mut self, id: CanId) {
        self.version = self.version.wrapping_add(1);
        if id.is_extended() {
            self.extended.push(id);
        } else {
            self.standard.insert(id.raw() as usize);
        }
    }

    pub(super) fn contains(&self, id: CanId) -> bool {
        if id.is_extended() {
            return self.extended.contains(&id);
        }
        self.standard.contains(id.raw() as usize)
    }

    pub(super) fn reset(&mut self, services: &Self) {
        self.version = self.version.wrapping_add(1);
        self.standard = services.standard;
        self.extended.clear();
    }
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
        let mut all = CanIdSet::default();
        all.insert(extended);
        assert!(all.contains(extended) && !all.contains(standard(0x205)));
        all.insert(standard(0x205));
        all.reset(&services);
        assert!(!all.contains(extended) && !all.contains(standard(0x205)));
        assert!(all.contains(standard(0x605)));
    }
}
