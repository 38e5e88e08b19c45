use alloc::collections::{BTreeMap, BTreeSet};
use alloc::string::String;
use alloc::vec::Vec;

use crate::{NodeId, object};

use super::data_type::DataType;
use super::data_value::DataValue;
use super::deviation::FileDeviation;
use super::device_module::DeviceModule;
use super::device_object::DeviceObject;
use super::file_sections::{Commissioning, DeviceInfo, FileInfo, Tool};
use super::file_value::FileValue;
use super::object_entry::ObjectEntry;
use super::value_error::ValueError;

/// Contents of an electronic data sheet (EDS) or a device configuration file (DCF, CiA 306-1).
///
/// Plain data that keeps everything that the file states, so that it can be written again. Two
/// files are equal if their contents are, without regard to [`warnings`](Self::warnings).
#[derive(Clone, Debug, Default)]
pub struct DeviceFile {
    /// About the file.
    pub file_info: FileInfo,
    /// About the device.
    pub device_info: DeviceInfo,
    /// Commissioning of the node; `None` in an EDS.
    pub commissioning: Option<Commissioning>,
    /// Comments.
    pub comments: Vec<String>,
    /// Dummy entries that an RPDO may contain: indices of data types.
    pub dummy_usage: BTreeSet<u16>,
    /// Modules that the device supports, by their number.
    pub modules: BTreeMap<u16, DeviceModule>,
    /// Numbers of the connected modules.
    pub connected_modules: Vec<u16>,
    /// Programs for the device.
    pub tools: Vec<Tool>,
    /// Sections that CiA 306-1 does not define, or that this model leaves as they are.
    pub other_sections: Vec<FileSection>,
    pub(super) objects: BTreeMap<u16, DeviceObject>,
    pub(super) warnings: Vec<FileDeviation>,
}

/// A section that is kept as it is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FileSection {
    /// Name.
    pub name: String,
    /// Keys and values.
    pub entries: Vec<(String, String)>,
}

/// Returns whether writing an object executes a command instead of setting a parameter.
pub(super) const fn is_command(index: u16) -> bool {
    matches!(index, object::ERROR_HISTORY | object::STORE_PARAMETERS | object::RESTORE_PARAMETERS)
}

impl PartialEq for DeviceFile {
    fn eq(&self, other: &Self) -> bool {
        let Self {
            file_info,
            device_info,
            commissioning,
            comments,
            dummy_usage,
            modules,
            connected_modules,
            tools,
            other_sections,
            objects,
            warnings: _,
        } = self;
        *file_info == other.file_info
            && *device_info == other.device_info
            && *commissioning == other.commissioning
            && *comments == other.comments
            && *dummy_usage == other.dummy_usage
            && *modules == other.modules
            && *connected_modules == other.connected_modules
            && *tools == other.tools
            && *other_sections == other.other_sections
            && *objects == other.objects
    }
}

impl Eq for DeviceFile {}

impl DeviceFile {
    /// Deviations from CiA 306-1 in the order of their lines.
    #[must_use]
    pub fn warnings(&self) -> &[FileDeviation] {
        &self.warnings
    }

    /// Returns whether the file is a DCF: it states the commissioning of a node.
    #[must_use]
    pub const fn is_dcf(&self) -> bool {
        self.commissioning.is_some()
    }

    /// The node-ID of the commissioning.
    #[must_use]
    pub fn node_id(&self) -> Option<NodeId> {
        self.commissioning.as_ref()?.node_id
    }

    /// The objects in the order of their indices.
    pub fn objects(&self) -> impl Iterator<Item = &DeviceObject> {
        self.objects.values()
    }

    /// All entries in the order of index and subindex.
    pub fn entries(&self) -> impl Iterator<Item = &ObjectEntry> {
        self.objects.values().flat_map(DeviceObject::entries)
    }

    /// The object with this index.
    #[must_use]
    pub fn object(&self, index: u16) -> Option<&DeviceObject> {
        self.objects.get(&index)
    }

    /// The object with this index, to change it.
    #[must_use]
    pub fn object_mut(&mut self, index: u16) -> Option<&mut DeviceObject> {
        self.objects.get_mut(&index)
    }

    /// Adds or replaces the object with the index of `object`.
    pub fn insert(&mut self, object: DeviceObject) {
        self.objects.insert(object.index, object);
    }

    /// The entry with this index and subindex.
    #[must_use]
    pub fn entry(&self, index: u16, subindex: u8) -> Option<&ObjectEntry> {
        self.object(index)?.entry(subindex)
    }

    /// The entry with this index and subindex, to change it.
    #[must_use]
    pub fn entry_mut(&mut self, index: u16, subindex: u8) -> Option<&mut ObjectEntry> {
        self.object_mut(index)?.entry_mut(subindex)
    }

    /// A DCF for a node: this file without any `ParameterValue`, with the commissioning and the name
    /// of this file as `LastEDS`. [`set_parameter`](Self::set_parameter) adds what the node
    /// returns for the [`parameters`](Self::parameters).
    #[must_use]
    pub fn to_dcf(&self, commissioning: Commissioning) -> Self {
        let mut dcf = self.clone();
        dcf.commissioning = Some(commissioning);
        if !self.is_dcf() {
            dcf.file_info.last_eds.clone_from(&self.file_info.file_name);
        }
        for object in dcf.objects.values_mut() {
            object.entries.values_mut().for_each(|entry| entry.parameter = None);
        }
        dcf
    }

    /// The entries whose values make up the configuration of a node, in the order of index and
    /// subindex: readable and writable, neither a DOMAIN nor excluded from scans (`ObjFlags`),
    /// without 0x1003, 0x1010 and 0x1011.
    pub fn parameters(&self) -> impl Iterator<Item = &ObjectEntry> {
        self.objects.values().filter(|object| !is_command(object.index)).flat_map(|object| {
            object.entries().filter(|entry| {
                entry.access.is_readable()
                    && entry.access.is_writable()
                    && entry.data_type != DataType::Domain
                    && !entry.flags.refuses_read_on_scan()
                    && !object.flags.refuses_read_on_scan()
            })
        })
    }

    /// Sets `ParameterValue` from the bytes that a node returned in an SDO.
    ///
    /// Returns `false` if the file has no such entry.
    ///
    /// # Errors
    /// [`ValueError::Length`] if the number of bytes is not that of the data type.
    pub fn set_parameter(
        &mut self,
        index: u16,
        subindex: u8,
        bytes: &[u8],
    ) -> Result<bool, ValueError> {
        let Some(entry) = self.entry_mut(index, subindex) else { return Ok(false) };
        let value: DataValue = entry.data_type.decode(bytes)?;
        entry.parameter = Some(FileValue::Fixed(value));
        Ok(true)
    }
}
