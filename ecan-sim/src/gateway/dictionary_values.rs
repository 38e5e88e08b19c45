//! Store of all SDO values: every integer entry of ecan-protocol's object dictionary.
//!
//! Configuration values are stored only here; the firmware decodes them when a command applies
//! them. Counters and states are computed on upload.

use ecan_protocol::object::{Object, objects};

/// Values of one object, in the order of its entries.
#[derive(Debug)]
struct Slot {
    index: u16,
    object: &'static Object,
    values: Box<[u32]>,
}

#[derive(Debug)]
pub(super) struct DictionaryValues {
    slots: Vec<Slot>,
}

impl DictionaryValues {
    pub(super) fn new() -> Self {
        let mut slots = Vec::new();
        for object in objects() {
            for instance in 0..object.count {
                slots.push(Slot {
                    index: object.first + instance * object.stride,
                    object,
                    values: object.entries.iter().map(|entry| entry.default.unwrap_or(0)).collect(),
                });
            }
        }
        slots.sort_by_key(|slot| slot.index);
        Self { slots }
    }

    pub(super) fn reset(&mut self) {
        for slot in &mut self.slots {
            for (value, entry) in slot.values.iter_mut().zip(slot.object.entries) {
                *value = entry.default.unwrap_or(0);
            }
        }
    }

    /// A stored value; 0 if there is no such entry.
    pub(super) fn get(&self, index: u16, subindex: u8) -> u32 {
        let Ok(at) = self.slots.binary_search_by_key(&index, |slot| slot.index) else {
            return 0;
        };
        let Some(slot) = self.slots.get(at) else {
            return 0;
        };
        slot.object
            .entries
            .binary_search_by_key(&subindex, |entry| entry.subindex)
            .ok()
            .and_then(|entry| slot.values.get(entry).copied())
            .unwrap_or(0)
    }

    pub(super) fn get_u8(&self, index: u16, subindex: u8) -> u8 {
        self.get(index, subindex).to_le_bytes()[0]
    }

    pub(super) fn get_u16(&self, index: u16, subindex: u8) -> u16 {
        let [low, high, ..] = self.get(index, subindex).to_le_bytes();
        u16::from_le_bytes([low, high])
    }

    /// Stores a value; ignored if there is no such entry.
    pub(super) fn set(&mut self, index: u16, subindex: u8, value: u32) {
        let Ok(at) = self.slots.binary_search_by_key(&index, |slot| slot.index) else {
            return;
        };
        let Some(slot) = self.slots.get_mut(at) else {
            return;
        };
        let Ok(entry) = slot.object.entries.binary_search_by_key(&subindex, |entry| entry.subindex)
        else {
            return;
        };
        if let Some(stored) = slot.values.get_mut(entry) {
            *stored = value;
        }
    }
}
