//! COB-IDs of the PDOs of an axis.

use ecan_protocol::can::CanId;

/// COB-IDs of the PDOs of an axis, in the order of their numbers. An empty list stands for those of the
/// predefined connection set (CiA 301, 7.3.3), which has PDOs 1 to 4 of a node.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PdoCobIds {
    /// Of the RPDOs, 0x181 to 0x57F.
    pub rpdos: Vec<CanId>,
    /// Of the TPDOs, 0x181 to 0x57F.
    pub tpdos: Vec<CanId>,
}

/// CAN IDs of PDOs: those that no other service of CiA 301 has.
const ALLOWED: std::ops::RangeInclusive<u32> = 0x181..=0x57F;

impl PdoCobIds {
    /// All COB-IDs that are no CAN ID of a PDO.
    pub(crate) fn invalid(&self) -> impl Iterator<Item = CanId> + '_ {
        let is_allowed = |id: &CanId| !id.is_extended() && ALLOWED.contains(&id.raw());
        self.rpdos.iter().chain(&self.tpdos).copied().filter(move |id| !is_allowed(id))
    }
}
