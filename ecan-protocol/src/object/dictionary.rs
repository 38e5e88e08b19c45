//! The table of all objects of the gateway, and the texts of their entries.

use core::fmt;

use super::declare::{InvalidValue, RangeFault, SdoWrite};
use super::entry::{Entry, Object};
use super::{
    capabilities, communication, data_path, diagnostic_test, diagnostics, maintenance,
    mcan_channel, pdo_profile, register_service,
};

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
    &maintenance::SYSTEM,
    &mcan_channel::MCAN_CHANNEL,
    &pdo_profile::TX_PDO_PROFILE,
    &pdo_profile::RX_PDO_PROFILE,
    &data_path::GLOBAL_DATA_PATH,
    &data_path::CHANNEL_DATA_PATH,
    &diagnostic_test::DIAGNOSTIC_TEST,
    &diagnostics::CHANNEL_INFORMATION,
    &diagnostics::CYCLE_PERFORMANCE,
    &diagnostics::DATA_PATH_DIAGNOSTICS,
    &register_service::REGISTER_SERVICE,
    &maintenance::MAINTENANCE,
    &capabilities::DEVICE_OBJECTS,
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

/// Text of an entry: `0x8010:03 (TxPDO Profile Control, PDO size multiplier)`.
///
/// The subindex is decimal. In a family the number of the object follows its name, counted from 0 like
/// the channels. An object that is not in the dictionary has its numbers only.
pub fn describe(index: u16, subindex: u8) -> impl fmt::Display {
    Description { index, subindex }
}

/// Text of a configuration field if the object is clear: `Node mode (subindex 8)`.
fn describe_field(index: u16, subindex: u8) -> impl fmt::Display {
    Field { name: lookup(index, subindex).map(|(_, entry)| entry.name), subindex }
}

struct Field {
    name: Option<&'static str>,
    subindex: u8,
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name {
            Some(name) => write!(f, "{name} (subindex {})", self.subindex),
            None => write!(f, "subindex {}", self.subindex),
        }
    }
}

struct Description {
    index: u16,
    subindex: u8,
}

impl fmt::Display for Description {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{:02}", self.index, self.subindex)?;
        let Some(object) = object(self.index) else {
            return Ok(());
        };
        f.write_str(" (")?;
        write_object_name(f, object, self.index)?;
        if let Some(entry) = object.entry(self.subindex) {
            write!(f, ", {}", entry.name)?;
        }
        f.write_str(")")
    }
}

/// Name of the object, followed by its number in a family.
fn write_object_name(f: &mut fmt::Formatter<'_>, object: &Object, index: u16) -> fmt::Result {
    f.write_str(object.name)?;
    match object.instance(index) {
        Some(instance) if object.count > 1 => write!(f, " {instance}"),
        _ => Ok(()),
    }
}

impl fmt::Display for SdoWrite {
    /// `0x8010:03 TxPDO Profile Control / PDO size multiplier = 8`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{:02}", self.index, self.subindex)?;
        if let Some(object) = object(self.index) {
            f.write_str(" ")?;
            write_object_name(f, object, self.index)?;
            if let Some(entry) = object.entry(self.subindex) {
                write!(f, " / {}", entry.name)?;
            }
        }
        write!(f, " = {}", self.value)
    }
}

impl fmt::Display for InvalidValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let field = describe_field(self.index, self.subindex);
        write!(f, "invalid value {} for {field}", self.value)
    }
}

impl fmt::Display for RangeFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { value, min, max, .. } = self;
        let field = describe_field(self.index, self.subindex);
        write!(f, "{field} = {value} is out of range; allowed: {min} to {max}")
    }
}
