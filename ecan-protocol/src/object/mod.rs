//! The object dictionary of the gateway (manual 13), and the declarations of the objects that a host
//! configures.
//!
//! The dictionary is one constant table. Subindices are decimal, as in the tables of the manual.
//! An object family (one object per channel or chunk) is one [`Object`] with a count and a stride.
//!
//! An object that a host configures is declared once, in its file here, by the macro `object!`:
//! struct, default, SDO downloads, dictionary rows and the keys of configuration files follow from
//! that declaration. The structs are public in [`config`](crate::config) and
//! [`image`](crate::image). A new object needs its own file, and a line in the table below.

mod abort_code;
mod channel_information;
mod communication;
pub(crate) mod data_path;
mod declare;
mod describe;
mod device;
pub(crate) mod diagnostic_test;
mod diagnostics;
mod entry;
pub(crate) mod filter_window;
mod maintenance;
pub(crate) mod mcan_channel;
pub(crate) mod message_ram;
mod object_type;
pub(crate) mod pdo_profile;
mod register_service;
mod sdo_write;
mod system;
mod value;

pub use abort_code::AbortCode;
pub use communication::{MAPPED_SUBINDEX, pdo_mapping_entry};
pub use declare::{ConfigObject, InvalidValue, RangeFault};
pub use describe::describe;
pub use entry::{Apply, Entry, Object};
pub use object_type::{Access, ObjectType};
pub use register_service::WRITABLE_REGISTERS;
pub use sdo_write::SdoWrite;
pub use value::KeyForm;

pub(crate) use value::{ObjectValue, largest, raw_default, raw_enum, status_enum};

/// Every object of the gateway, in ascending order of index.
static OBJECTS: [&Object; 25] = [
    &communication::DEVICE_TYPE,
    &communication::DEVICE_NAME,
    &communication::HARDWARE_VERSION,
    &communication::SOFTWARE_VERSION,
    &communication::IDENTITY,
    &communication::RX_PDO_MAPPING,
    &communication::TX_PDO_MAPPING,
    &communication::SYNC_MANAGER_TYPES,
    &communication::RX_PDO_ASSIGNMENT,
    &communication::TX_PDO_ASSIGNMENT,
    &communication::INPUT_DATA,
    &communication::OUTPUT_DATA,
    &system::SYSTEM,
    &mcan_channel::MCAN_CHANNEL,
    &pdo_profile::TX_PDO_PROFILE,
    &pdo_profile::RX_PDO_PROFILE,
    &data_path::GLOBAL_DATA_PATH,
    &data_path::CHANNEL_DATA_PATH,
    &diagnostic_test::DIAGNOSTIC_TEST,
    &channel_information::CHANNEL_INFORMATION,
    &diagnostics::CYCLE_PERFORMANCE,
    &diagnostics::DATA_PATH_DIAGNOSTICS,
    &register_service::REGISTER_SERVICE,
    &maintenance::MAINTENANCE,
    &device::DEVICE_OBJECTS,
];

/// Returns every object of the gateway in ascending order of index; a family is listed once.
pub fn objects() -> &'static [&'static Object] {
    &OBJECTS
}

/// Returns the object (or the family) of an index.
pub fn object(index: u16) -> Option<&'static Object> {
    OBJECTS.iter().copied().find(|object| object.instance(index).is_some())
}

/// Returns the object and the entry at an index and subindex.
pub fn lookup(index: u16, subindex: u8) -> Option<(&'static Object, &'static Entry)> {
    let object = object(index)?;
    Some((object, object.entry(subindex)?))
}
