use alloc::collections::BTreeMap;
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use super::access_type::AccessType;
use super::data_type::DataType;
use super::data_value::DataValue;
use super::file_value::FileValue;
use super::object_entry::{ObjectEntry, ObjectFlags};
use super::object_type::ObjectType;

/// Object of a device with its sub-objects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceObject {
    /// Index.
    pub index: u16,
    /// `ParameterName`.
    pub name: String,
    /// Type.
    pub object_type: ObjectType,
    /// `ObjFlags` of an object with sub-objects.
    pub flags: ObjectFlags,
    /// `Denotation` of an object with sub-objects.
    pub denotation: String,
    /// True if the file describes all sub-objects together (`CompactSubObj`).
    pub is_compact: bool,
    /// Indices of related objects (`[xxxxObjectLinks]`).
    pub links: Vec<u16>,
    /// Entries of an object with sub-objects that CiA 306-1 does not define there.
    pub extra: Vec<(String, String)>,
    pub(super) entries: BTreeMap<u8, ObjectEntry>,
}

impl DeviceObject {
    /// An object of this type without sub-objects; add them with [`insert`](Self::insert).
    #[must_use]
    pub fn new(index: u16, name: &str, object_type: ObjectType) -> Self {
        Self {
            index,
            name: name.into(),
            object_type,
            flags: ObjectFlags::default(),
            denotation: String::new(),
            is_compact: false,
            links: Vec::new(),
            extra: Vec::new(),
            entries: BTreeMap::new(),
        }
    }

    /// A VAR, DOMAIN or DEFTYPE.
    #[must_use]
    pub fn variable(entry: ObjectEntry) -> Self {
        let mut object = Self::new(entry.index, &entry.name, entry.object_type);
        object.insert(entry);
        object
    }

    /// Adds or replaces the sub-object with the subindex of `entry`.
    pub fn insert(&mut self, entry: ObjectEntry) {
        self.entries.insert(entry.subindex, entry);
    }

    /// The entries in the order of their subindices; one with subindex 0 if the object has no
    /// sub-objects.
    pub fn entries(&self) -> impl Iterator<Item = &ObjectEntry> {
        self.entries.values()
    }

    /// The entry with this subindex.
    #[must_use]
    pub fn entry(&self, subindex: u8) -> Option<&ObjectEntry> {
        self.entries.get(&subindex)
    }

    /// The entry with this subindex, to change it.
    #[must_use]
    pub fn entry_mut(&mut self, subindex: u8) -> Option<&mut ObjectEntry> {
        self.entries.get_mut(&subindex)
    }

    /// Sub-object 0 that a compact description implies.
    pub(super) fn compact_count(index: u16, count: u8) -> ObjectEntry {
        ObjectEntry {
            access: AccessType::ReadOnly,
            default: Some(FileValue::Fixed(DataValue::Unsigned(count.into()))),
            ..ObjectEntry::new(index, 0, "NrOfObjects", DataType::Unsigned8)
        }
    }

    /// Number of sub-objects if a compact description can hold the object: apart from name, value,
    /// denotation and reference, all sub-objects must be alike.
    pub(super) fn compact_size(&self) -> Option<u8> {
        let count = u8::try_from(self.entries.len().checked_sub(1)?).ok()?;
        if !self.is_compact || !(1..=254).contains(&count) {
            return None;
        }
        let first = self.entry(1)?;
        let has_own_parts = first.object_type != ObjectType::Var
            || first.flags != self.flags
            || !first.upload_file.is_empty()
            || !first.download_file.is_empty()
            || !first.extra.is_empty();
        if has_own_parts {
            return None;
        }
        let is_alike = |subindex| {
            self.entry(subindex).is_some_and(|entry| {
                let same = ObjectEntry {
                    subindex,
                    name: entry.name.clone(),
                    parameter: entry.parameter.clone(),
                    denotation: entry.denotation.clone(),
                    reference: entry.reference.clone(),
                    ..first.clone()
                };
                *entry == same && !entry.name.is_empty()
            })
        };
        let has_count = self.entry(0) == Some(&Self::compact_count(self.index, count));
        (has_count && (1..=count).all(is_alike)).then_some(count)
    }
}

/// Name of a sub-object of a compact description that gives none.
pub(super) fn compact_name(object: &str, subindex: u8) -> String {
    format!("{object}{subindex}")
}
