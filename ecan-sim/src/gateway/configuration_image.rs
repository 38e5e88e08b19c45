//! Saved configuration: values of the saved objects and the filter lists, without commands, editing
//! windows and runtime state (manual 13.3, 13.4, 13.7).
//!
//! The manual gives no format, only a CRC32 over the image. This format is: the letters `ECFG`, a
//! format number, the common objects, the four channels, the CRC32 of all that, all little endian.
//! A channel is saved with the information whether its controller runs, so that it runs again after
//! a load.

use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::object::{Entry, Object, object, objects};

use super::channel_control::{FIRST_CHANNEL_OBJECT, FilterLists};
use super::dictionary_values::DictionaryValues;
use super::firmware_update::crc32;
use super::message_ram::FilterElement;

const MAGIC: [u8; 4] = *b"ECFG";
const FORMAT: u32 = 1;
const PREFIX_BYTES: usize = 8;
const FILTER_BYTES: usize = 11;

/// Saved objects that belong to no single channel.
fn common_objects() -> impl Iterator<Item = u16> {
    let saved = objects().iter().filter(|object| object.is_saved);
    saved.filter(|object| object.first != FIRST_CHANNEL_OBJECT).flat_map(|object| object.indices())
}

/// A saved configuration, in the parts that are saved and loaded separately.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ConfigurationImage {
    common: Vec<u8>,
    channels: [Vec<u8>; CHANNELS],
}

fn saved_entries(index: u16) -> impl Iterator<Item = &'static Entry> {
    object(index).into_iter().flat_map(Object::saved_entries)
}

fn save_object(index: u16, values: &DictionaryValues, out: &mut Vec<u8>) {
    for entry in saved_entries(index) {
        let bytes = values.get(index, entry.subindex).to_le_bytes();
        out.extend(bytes.iter().take(entry.ty.size_bytes().unwrap_or(bytes.len())));
    }
}

/// Takes the values of an object from the start of `bytes`.
fn restore_object(index: u16, values: &mut DictionaryValues, bytes: &mut &[u8]) {
    for entry in saved_entries(index) {
        let size = entry.ty.size_bytes().unwrap_or(4);
        let Some((field, rest)) = bytes.split_at_checked(size) else {
            return;
        };
        *bytes = rest;
        let mut raw = [0; 4];
        raw[..size].copy_from_slice(field);
        values.set(index, entry.subindex, u32::from_le_bytes(raw));
    }
}

fn save_filter(element: &FilterElement, out: &mut Vec<u8>) {
    out.extend([element.kind, element.action, element.sync]);
    out.extend(element.id1.to_le_bytes());
    out.extend(element.id2.to_le_bytes());
}

fn restore_filter(bytes: &[u8; FILTER_BYTES]) -> FilterElement {
    let &[kind, action, sync, a, b, c, d, e, f, g, h] = bytes;
    FilterElement {
        kind,
        action,
        sync,
        id1: u32::from_le_bytes([a, b, c, d]),
        id2: u32::from_le_bytes([e, f, g, h]),
    }
}

impl ConfigurationImage {
    /// The present configuration; `runs` states for each channel whether its controller runs.
    pub(super) fn collect(
        values: &DictionaryValues,
        filters: &[FilterLists; CHANNELS],
        runs: [bool; CHANNELS],
    ) -> Self {
        let mut common = Vec::new();
        common_objects().for_each(|index| save_object(index, values, &mut common));
        let mut channels = [const { Vec::new() }; CHANNELS];
        for (number, out) in channels.iter_mut().enumerate() {
            out.push(u8::from(runs[number]));
            save_object(FIRST_CHANNEL_OBJECT + number as u16, values, out);
            for element in filters[number].elements() {
                save_filter(element, out);
            }
        }
        Self { common, channels }
    }

    pub(super) fn factory() -> Self {
        let filters = std::array::from_fn(|_| FilterLists::new());
        Self::collect(&DictionaryValues::new(), &filters, [false; CHANNELS])
    }

    pub(super) fn replace_channel(&mut self, number: usize, from: &Self) {
        self.channels[number].clone_from(&from.channels[number]);
    }

    pub(super) fn restore_common(&self, values: &mut DictionaryValues) {
        let mut bytes = self.common.as_slice();
        for index in common_objects() {
            restore_object(index, values, &mut bytes);
        }
    }

    /// Restores one channel; returns whether it ran when it was saved.
    pub(super) fn restore_channel(
        &self,
        number: usize,
        values: &mut DictionaryValues,
        lists: &mut FilterLists,
    ) -> bool {
        let Some((&runs, mut bytes)) = self.channels[number].split_first() else {
            return false;
        };
        restore_object(FIRST_CHANNEL_OBJECT + number as u16, values, &mut bytes);
        let (stored, _) = bytes.as_chunks::<FILTER_BYTES>();
        for (element, stored) in lists.elements_mut().zip(stored) {
            *element = restore_filter(stored);
        }
        runs != 0
    }

    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = self.checked_bytes();
        bytes.extend(self.crc().to_le_bytes());
        bytes
    }

    pub(super) fn crc(&self) -> u32 {
        crc32(&self.checked_bytes())
    }

    fn checked_bytes(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(FORMAT.to_le_bytes());
        bytes.extend(&self.common);
        for channel in &self.channels {
            bytes.extend(channel);
        }
        bytes
    }

    /// Parses stored bytes; `None` if their CRC is invalid.
    pub(super) fn parse(bytes: &[u8]) -> Option<Self> {
        let (checked, check) = bytes.split_last_chunk::<4>()?;
        if crc32(checked) != u32::from_le_bytes(*check) {
            return None;
        }
        // valid, so every part has the length of the factory configuration
        let mut rest = checked.get(PREFIX_BYTES..)?;
        let mut image = Self::factory();
        for part in std::iter::once(&mut image.common).chain(&mut image.channels) {
            let (stored, remaining) = rest.split_at_checked(part.len())?;
            part.copy_from_slice(stored);
            rest = remaining;
        }
        Some(image)
    }
}
