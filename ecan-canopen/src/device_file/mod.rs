//! Device files: electronic data sheets (EDS) and device configuration files (DCF, CiA 306-1).
//!
//! `contents` is what a file states, and finds entries by name. `file_text` reads a file, with
//! `object_reader` and `entry_reader` for its objects, and writes it again; `ini` is the syntax for both, and
//! `sections` declares the sections with fixed entries. `value_text` and `data_value` are the values as text
//! and as bytes. `downloads` lists the SDO downloads that configure a node.

mod contents;
mod data_type;
mod data_value;
mod deviation;
mod device_object;
mod downloads;
mod entry_reader;
mod file_text;
mod ini;
mod object_reader;
mod sections;
mod value_text;

pub use contents::{DeviceFile, DeviceModule, FileSection, FindError, SubExtension};
pub use data_type::{AccessType, DataType, ObjectType};
pub use data_value::{DataValue, FileValue, ValueError};
pub use deviation::{DeviceFileFaults, FileDeviation, FileProblem};
pub use device_object::{DeviceObject, ObjectEntry, ObjectFlags};
pub use downloads::{
    ConciseDcfError, Download, DownloadError, DownloadScope, decode_concise_dcf, encode_concise_dcf,
};
pub use sections::{BitRates, Commissioning, DeviceInfo, FileInfo, ModuleInfo, Tool};
pub use value_text::ValueNote;
