use alloc::string::String;
use alloc::vec::Vec;

use crate::NodeId;

use super::access_type::AccessType;
use super::data_type::DataType;
use super::data_value::DataValue;
use super::file_value::FileValue;
use super::object_type::ObjectType;

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
