//! The values of a DCF.

use std::path::Path;

use ecan_canopen::{DataType, DataValue, DeviceFile, NodeId, ObjectEntry};

use crate::commands::node::motion_objects::moves_a_motor;
use crate::commands::node::object_names::{ObjectKey, read_device_file};
use crate::context::{Failure, Result};

/// Program download (CiA 302-3): a write can erase the firmware.
const PROGRAMS: std::ops::RangeInclusive<u16> = 0x1F50..=0x1F5F;

/// Returns whether an object is a parameter, and no command.
pub fn is_parameter(index: u16) -> bool {
    !moves_a_motor(index) && !PROGRAMS.contains(&index)
}

/// Reads a DCF.
///
/// # Errors
/// The file cannot be read, or it is an EDS, which has no values.
pub fn read(path: &Path) -> Result<DeviceFile> {
    let file = read_device_file(path)?;
    match file.is_dcf() {
        true => Ok(file),
        false => Err(Failure::file(
            "use",
            path,
            "an EDS has no values of a node; use a DCF, for example of `ecan node params save`",
        )),
    }
}

/// Value of a parameter in a DCF.
#[derive(Clone, Debug)]
pub struct StoredValue<'f> {
    pub entry: &'f ObjectEntry,
    pub value: DataValue,
}

impl StoredValue<'_> {
    pub fn key(&self) -> ObjectKey {
        (self.entry.index, self.entry.subindex)
    }

    /// Returns whether the bytes of the node are this value.
    pub fn is_same(&self, bytes: &[u8]) -> bool {
        decode(self.entry.data_type, bytes).as_ref() == Some(&self.value)
    }
}

/// The parameters of a DCF that can be read from a node, with their values, in the order of index and
/// subindex.
pub fn values(file: &DeviceFile, node: NodeId) -> Vec<StoredValue<'_>> {
    let entries = file.parameters().filter(|entry| is_parameter(entry.index));
    let value = |entry| {
        let value = ObjectEntry::parameter_value(entry, node)?;
        Some(StoredValue { entry, value })
    };
    entries.filter_map(value).collect()
}

/// The value of these bytes; of a text without the zeros at its end. `None` for another length.
pub fn decode(data_type: DataType, bytes: &[u8]) -> Option<DataValue> {
    data_type.decode(bytes).ok().map(|value| match value {
        DataValue::Text(text) => DataValue::Text(text.trim_end_matches('\0').into()),
        value => value,
    })
}
