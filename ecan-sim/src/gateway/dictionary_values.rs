//! Store of all SDO values: every integer entry of ecan-protocol's object dictionary.
//!
//! Configuration values are stored only here; the firmware decodes them when a command applies
//! them. Counters and states are computed on upload.

use ecan_protocol::object::{Object, objects};

/// Values of one object, in the order of its entries.
#[derive(Clone, Debug)]
struct Slot {
    index: u16,
    object: &'static Object,
    values: Box<[u32]>,
}

#[derive(Clone, Debug)]
pub(super) struct DictionaryValues {
    slots: Vec<Slot>,
}

impl DictionaryValues {
    pub(super) fn new() -> Self {
        let mut slots = Vec::new();
        for object in objects() {
            for index in object.indices() {
                slots.push(Slot {
                    index,
                    object,
                    values: object.entries.iter().map(|entry| entry.default.unwrap_or(0)).collect(),
                });
            }
        }
        slots.sort_by_key(|slot| slot.index);
        Self { slots }
    }

    /// A stored value; 0 if there is no such entry.
    pub(super) fn get(&self, index: u16, subindex: u8) -> u32 {
        self.position(index, subindex).map_or(0, |(slot, entry)| self.slots[slot].values[entry])
    }

    fn position(&self, index: u16, subindex: u8) -> Option<(usize, usize)> {
        let slot = self.slots.binary_search_by_key(&index, |slot| slot.index).ok()?;
        let entries = self.slots[slot].object.entries;
        let entry = entries.binary_search_by_key(&subindex, |entry| entry.subindex).ok()?;
        Some((slot, entry))
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
        if let Some((slot, entry)) = self.position(index, subindex) {
            self.slots[slot].values[entry] = value;
        }
    }
}
