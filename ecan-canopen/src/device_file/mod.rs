//! Device files: electronic data sheets (EDS) and device configuration files (DCF, CiA 306-1).
//!
//! `ini` reads the syntax, `parse` with `object_reader` and `entry_reader` the contents, and `write`
//! writes them again; `section_fields` declares sections with fixed entries for both. `value_text` and
//! `data_value` are the values as text and as bytes. `find` looks entries up by name, `downloads` lists
//! the SDO downloads that configure a node, and `concise_dcf` holds them in one value.

mod access_type;
mod concise_dcf;
mod data_type;
mod data_value;
mod deviation;
#[expect(clippy::module_inception, reason = "a file has the name of its main type")]
mod device_file;
mod device_module;
mod device_object;
mod downloads;
mod entry_reader;
mod file_sections;
mod file_value;
mod find;
mod ini;
mod object_entry;
mod object_list;
mod object_reader;
mod object_type;
mod output;
mod parse;
mod section_fields;
mod section_name;
mod value_error;
mod value_text;
mod write;

pub use access_type::AccessType;
pub use concise_dcf::{ConciseDcfError, Download, decode_concise_dcf, encode_concise_dcf};
pub use data_type::DataType;
pub use data_value::DataValue;
pub use deviation::{DeviceFileFaults, FileDeviation, FileProblem};
pub use device_file::{DeviceFile, FileSection};
pub use device_module::{DeviceModule, SubExtension};
pub use device_object::DeviceObject;
pub use downloads::{DownloadError, DownloadScope};
pub use file_sections::{Commissioning, DeviceInfo, FileInfo, ModuleInfo, Tool};
pub use file_value::FileValue;
pub use find::FindError;
pub use object_entry::{ObjectEntry, ObjectFlags};
pub use object_type::ObjectType;
pub use section_fields::BitRates;
pub use value_error::ValueError;
pub use value_text::ValueNote;
