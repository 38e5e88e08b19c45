//! Objects of a device: their entries, and the lists to which they belong (CiA 306-1, 6.6.3).

use alloc::collections::BTreeMap;
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use super::data_type::{AccessType, DataType, ObjectType};
use super::data_value::{DataValue, FileValue};
use crate::{NodeId, object};

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

/// Value of a device: an object without sub-objects, or one sub-object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectEntry {
    /// Index.
    pub index: u16,
    /// Subindex; 0 for an object without sub-objects.
    pub subindex: u8,
    /// `ParameterName`; that of the object if it has no sub-objects.
    pub name: String,
    /// Type of the object: VAR, DOMAIN or DEFTYPE.
    pub object_type: ObjectType,
    /// Data type.
    pub data_type: DataType,
    /// Access.
    pub access: AccessType,
    /// True if a PDO may contain it (`PDOMapping`).
    pub pdo_mapping: bool,
    /// `LowLimit` of a number.
    pub low_limit: Option<FileValue>,
    /// `HighLimit` of a number.
    pub high_limit: Option<FileValue>,
    /// `DefaultValue`.
    pub default: Option<FileValue>,
    /// `ParameterValue` of a DCF.
    pub parameter: Option<FileValue>,
    /// Reference designation of the parameter (`ParamRefd`).
    pub reference: String,
    /// `Denotation`: name of the parameter in the application.
    pub denotation: String,
    /// `ObjFlags`.
    pub flags: ObjectFlags,
    /// `UploadFile` of a DOMAIN.
    pub upload_file: String,
    /// `DownloadFile` of a DOMAIN.
    pub download_file: String,
    /// Entries that CiA 306-1 does not define, or whose value is invalid.
    pub extra: Vec<(String, String)>,
}

/// `ObjFlags` of an object (CiA 306-1, 6.6.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ObjectFlags(pub u32);

impl ObjectFlags {
    /// Returns whether a download of a whole configuration must leave the object out.
    #[must_use]
    pub const fn refuses_write_on_download(self) -> bool {
        self.0 & 1 != 0
    }

    /// Returns whether an upload of a whole configuration must leave the object out.
    #[must_use]
    pub const fn refuses_read_on_scan(self) -> bool {
        self.0 & 2 != 0
    }
}

impl ObjectEntry {
    /// A readable and writable variable without limits and values.
    #[must_use]
    pub fn new(index: u16, subindex: u8, name: &str, data_type: DataType) -> Self {
        Self {
            index,
            subindex,
            name: name.into(),
            object_type: match data_type {
                DataType::Domain => ObjectType::Domain,
                _ => ObjectType::Var,
            },
            data_type,
            access: AccessType::ReadWrite,
            pdo_mapping: false,
            low_limit: None,
            high_limit: None,
            default: None,
            parameter: None,
            reference: String::new(),
            denotation: String::new(),
            flags: ObjectFlags::default(),
            upload_file: String::new(),
            download_file: String::new(),
            extra: Vec::new(),
        }
    }

    fn resolve(&self, value: Option<&FileValue>, node: NodeId) -> Option<DataValue> {
        value.map(|value| value.resolve(self.data_type, node))
    }

    /// `DefaultValue` for a node.
    #[must_use]
    pub fn default_value(&self, node: NodeId) -> Option<DataValue> {
        self.resolve(self.default.as_ref(), node)
    }

    /// `ParameterValue` for a node.
    #[must_use]
    pub fn parameter_value(&self, node: NodeId) -> Option<DataValue> {
        self.resolve(self.parameter.as_ref(), node)
    }

    /// `ParameterValue` for a node, otherwise `DefaultValue`.
    #[must_use]
    pub fn configured_value(&self, node: NodeId) -> Option<DataValue> {
        self.parameter_value(node).or_else(|| self.default_value(node))
    }

    /// `LowLimit` and `HighLimit` for a node.
    #[must_use]
    pub fn limits(&self, node: NodeId) -> (Option<DataValue>, Option<DataValue>) {
        let limit = |value: &Option<FileValue>| self.resolve(value.as_ref(), node);
        (limit(&self.low_limit), limit(&self.high_limit))
    }

    /// Returns whether a TPDO may contain the value.
    #[must_use]
    pub fn is_tpdo_mappable(&self) -> bool {
        let is_input = !matches!(self.access, AccessType::WriteOnly | AccessType::ReadWriteOutput);
        self.pdo_mapping && is_input && self.data_type.pdo_bits().is_some()
    }

    /// Returns whether an RPDO may contain the value.
    #[must_use]
    pub fn is_rpdo_mappable(&self) -> bool {
        let is_output = self.access.is_writable() && self.access != AccessType::ReadWriteInput;
        self.pdo_mapping && is_output && self.data_type.pdo_bits().is_some()
    }
}

/// Lists, the mandatory objects first.
pub(super) const LISTS: [&str; 3] = ["MandatoryObjects", "OptionalObjects", "ManufacturerObjects"];
/// Objects that each device has (CiA 301, 7.5.1).
pub(super) const MANDATORY: [u16; 3] =
    [object::DEVICE_TYPE, object::ERROR_REGISTER, object::IDENTITY];

/// The list to which an object belongs.
pub(super) fn list_of(index: u16) -> &'static str {
    let [mandatory, optional, manufacturer] = LISTS;
    match index {
        index if MANDATORY.contains(&index) => mandatory,
        0x2000..=0x5FFF => manufacturer,
        _ => optional,
    }
}
