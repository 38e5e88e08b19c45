//! The object dictionary of the gateway (manual 13), and the declarations of the objects that a host
//! configures.
//!
//! The dictionary is one constant table. Subindices are decimal, as in the tables of the manual.
//! An object family (one object per channel or chunk) is one [`Object`] with a count and a stride.
//!
//! An object that a host configures is declared once, in its file here, by the macro `object!`:
//! struct, default, SDO downloads, dictionary rows and the keys of configuration files follow from
//! that declaration. The structs are public in [`config`](crate::config) and
//! [`image`](crate::image). A new object needs its own file, and a line in the table of `dictionary`.

mod abort_code;
pub(crate) mod capabilities;
pub(crate) mod communication;
pub(crate) mod data_path;
mod declare;
pub(crate) mod diagnostic_test;
mod diagnostics;
mod dictionary;
mod entry;
pub(crate) mod filter_window;
pub(crate) mod filters;
pub(crate) mod maintenance;
pub(crate) mod mcan_channel;
pub(crate) mod mcan_channel_check;
pub(crate) mod message_ram;
pub(crate) mod pdo_profile;
pub(crate) mod register_service;
mod value;

pub use abort_code::AbortCode;
pub use communication::{MAPPED_SUBINDEX, pdo_mapping_entry};
pub use declare::{ConfigObject, InvalidValue, RangeFault, SdoWrite};
pub use dictionary::{describe, lookup, object, objects};
pub use entry::{Apply, Entry, Object, WriteResult};
pub use register_service::WRITABLE_REGISTERS;
pub use value::{Access, KeyForm, ObjectType};

pub(crate) use value::{ObjectValue, largest, raw_default, raw_enum, status_enum};
