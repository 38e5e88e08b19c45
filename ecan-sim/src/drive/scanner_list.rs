//! Object scanner list of multiplexed PDOs (CiA 301, 7.5.2.41).

use ecan_canopen::{ScannerEntry, object};

use super::dictionary::{Dictionary, Slot};

/// Object of the scanner list, with the value that was sent last.
#[derive(Clone, Debug)]
pub(super) struct ScannedObject {
    pub(super) slot: Slot,
    sent: Option<u64>,
}

/// Objects of the scanner list 0x1FA0 that exist and have up to four bytes.
pub(super) fn scanned_objects(objects: &Dictionary) -> Vec<ScannedObject> {
    let count = objects.number(object::SCANNER_LIST, 0).unwrap_or(0).clamp(0, 254) as u8;
    let entries = (1..=count)
        .filter_map(|nth| objects.number(object::SCANNER_LIST, nth))
        .filter_map(|raw| ScannerEntry::from_raw(raw as u32));
    entries
        .flat_map(|entry| {
            (0..entry.count).filter_map(move |nth| {
                let slot = objects.find((entry.index, entry.subindex.checked_add(nth)?)).ok()?;
                let size = objects.object(slot)?.data_type.size()?;
                (size <= 4).then_some(ScannedObject { slot, sent: None })
            })
        })
        .collect()
}

impl ScannedObject {
    /// Returns the value if it changed since it was sent.
    pub(super) fn take_change(&mut self, objects: &Dictionary) -> Option<u64> {
        let value = objects.raw(self.slot);
        (self.sent.replace(value) != Some(value)).then_some(value)
    }

    pub(super) fn restart(&mut self) {
        self.sent = None;
    }
}
