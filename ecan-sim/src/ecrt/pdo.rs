//! PDOs, the sync managers that carry them, and the SDO writes of their assignment and mapping after the startup
//! SDOs.

use crate::sii::SlaveDescription;
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

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum SyncWatchdog {
    #[default]
    Default,
    Enable,
    Disable,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct SyncConfig {
    pub(crate) direction: Option<ProcessDirection>,
    pub(crate) watchdog: SyncWatchdog,
    pub(crate) pdos: Vec<Pdo>,
}

/// One write, and where to continue if the slave aborts it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct AssignmentWrite {
    pub(crate) index: u16,
    pub(crate) subindex: u8,
    pub(crate) value: u32,
    pub(crate) size: usize,
    pub(crate) after_failure: usize,
}

const FIRST_PROCESS_SYNC: u8 = 2;

/// The writes of the sync managers of a configuration that the SII of the slave allows.
///
/// A count that cannot be cleared skips its object, a PDO that cannot be assigned ends the list.
pub(crate) fn assignment_writes(
    syncs: &[SyncConfig],
    slave: &SlaveDescription,
) -> Vec<AssignmentWrite> {
    let mut list = Vec::new();
    for number in FIRST_PROCESS_SYNC..SYNC_MANAGERS {
        let Some(sync) = syncs.get(usize::from(number)) else { continue };
        for pdo in sync.pdos.iter().filter(|_| slave.pdo_configuration) {
            let entries = pdo.entries.iter().map(|entry| {
                let object = u32::from(entry.index) << 16 | u32::from(entry.subindex) << 8;
                (object | u32::from(entry.bits), 4)
            });
            push_list(&mut list, pdo.index, entries, false);
        }
        if slave.pdo_assign {
            let pdos = sync.pdos.iter().map(|pdo| (u32::from(pdo.index), 2));
            push_list(&mut list, 0x1C10 + u16::from(number), pdos, true);
        }
    }
    list
}

/// Count to 0, the entries, the count.
fn push_list(
    list: &mut Vec<AssignmentWrite>,
    index: u16,
    entries: impl Iterator<Item = (u32, usize)>,
    fatal: bool,
) {
    let first = list.len();
    let mut push = |subindex, value, size| {
        list.push(AssignmentWrite { index, subindex, value, size, after_failure: 0 });
    };
    push(0, 0, 1);
    let mut count = 0u8;
    for (value, size) in entries {
        count = count.saturating_add(1);
        push(count, value, size);
    }
    if count > 0 {
        push(0, u32::from(count), 1);
    }
    let end = list.len();
    for (index, write) in list.iter_mut().enumerate().skip(first) {
        write.after_failure = if fatal && index > first { usize::MAX } else { end };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn assignment_is_cleared_written_and_counted() {
        let mut syncs: [SyncConfig; 4] = Default::default();
        syncs[2].pdos = [0x1600, 0x1601].map(|index| Pdo { index, entries: Vec::new() }).to_vec();
        let slave = SlaveDescription::of_gateway(&crate::scenario::GatewaySpec::at(0));
        let list = assignment_writes(&syncs, &slave);
        let lines: Vec<_> = list.iter().map(|w| (w.index, w.subindex, w.value, w.size)).collect();
        assert_eq!(
            lines,
            [
                (0x1C12, 0, 0, 1),
                (0x1C12, 1, 0x1600, 2),
                (0x1C12, 2, 0x1601, 2),
                (0x1C12, 0, 2, 1),
                (0x1C13, 0, 0, 1),
            ]
        );
        assert_eq!(list[0].after_failure, 4);
        assert_eq!(list[1].after_failure, usize::MAX);
        let fixed = SlaveDescription { pdo_assign: false, ..slave };
        assert!(assignment_writes(&syncs, &fixed).is_empty());
    }
}
