use alloc::collections::BTreeMap;
use alloc::string::String;
use alloc::vec::Vec;

use super::device_object::DeviceObject;
use super::file_sections::ModuleInfo;
use super::object_entry::ObjectEntry;

/// Module that a modular device supports (CiA 306-1, 8.3).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DeviceModule {
    /// Identification of the module.
    pub info: ModuleInfo,
    /// Comments.
    pub comments: Vec<String>,
    /// Objects that exist if at least one such module is connected (`[MxFixedxxxx]`), by index.
    pub fixed_objects: BTreeMap<u16, DeviceObject>,
    /// Sub-objects that each such module adds (`[MxSubExtxxxx]`), by index.
    pub extensions: BTreeMap<u16, SubExtension>,
}

/// Sub-objects that a module adds to an object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SubExtension {
    /// Description of each added sub-object; its subindex is 0.
    pub entry: ObjectEntry,
    /// `Count`: number of added sub-objects, as in the file.
    pub count: String,
    /// `ObjExtend`: what happens if the object has no free subindex, as in the file.
    pub obj_extend: String,
}
