//! PDOs with their mapping, and the sync managers that carry them.

use crate::world::ProcessDirection;

/// Sync managers of the gateway: two mailboxes, outputs, inputs.
pub(super) const SYNC_MANAGERS: u8 = 4;
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PdoEntry {
    pub(crate) index: u16,
    pub(crate) subindex: u8,
    pub(crate) bits: u8,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Pdo {
    pub(crate) index: u16,
    pub(crate) entries: Vec<PdoEntry>,
}

impl Pdo {
    pub(crate) fn bits(&self) -> usize {
        self.entries.iter().map(|entry| usize::from(entry.bits)).sum()
    }
}

/// Size of a list of PDOs in bytes.
pub(crate) fn pdo_bytes(pdos: &[Pdo]) -> usize {
    pdos.iter().map(Pdo::bits).sum::<usize>().div_ceil(8)
}

pub(crate) fn direction_of(sync_manager: u8) -> Option<ProcessDirection> {
    match sync_manager {
        0 | 2 => Some(ProcessDirection::Output),
        1 | 3 => Some(ProcessDirection::Input),
        _ => None,
    }
}
