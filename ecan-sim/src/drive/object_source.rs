//! Source of the objects of a node.

use std::sync::Arc;

use ecan_canopen::{DeviceFile, object};

use super::axis_objects::{MOST_AXES, axis_index};
use super::config::DriveConfig;
use super::default_objects::{default_objects, fill_in};
use super::dictionary::{Dictionary, Object, Value};
use super::file_objects::file_objects;

/// Source of the objects of a node, whose defaults depend on the node-ID.
#[derive(Clone, Debug)]
pub(super) enum ObjectSource {
    BuiltIn,
    File(Arc<DeviceFile>),
}

impl ObjectSource {
    /// The objects, and whether they are those of a drive.
    pub(super) fn objects(&self, config: &DriveConfig) -> (Dictionary, bool) {
        let motor = &config.motor;
        let mut list = match self {
            Self::BuiltIn => default_objects(config),
            Self::File(file) => file_objects(file, config.node, config.serial),
        };
        let is_drive = is_drive(&list);
        if is_drive {
            fill_in(&mut list, motor);
        }
        list.retain(|object| !config.quirks.missing.contains(&object.index));
        (Dictionary::new(list), is_drive)
    }

    /// Axes of the drive: those with controlword and statusword in a row; at least one.
    pub(super) fn axis_count(&self, objects: &Dictionary) -> usize {
        let has = |axis, index| objects.has(axis_index(axis, index));
        let is_axis =
            |axis: &usize| has(*axis, object::CONTROLWORD) && has(*axis, object::STATUSWORD);
        (0..MOST_AXES).take_while(is_axis).count().max(1)
    }
}

/// Returns whether the objects are those of a drive: by the device type, or by controlword and
/// statusword.
fn is_drive(objects: &[Object]) -> bool {
    let has = |index| objects.iter().any(|object| object.index == index);
    let profile = objects.iter().find(|object| object.key() == (object::DEVICE_TYPE, 0));
    let is_402 = profile.is_some_and(|object| {
        matches!(object.default, Value::Number(device_type) if device_type & 0xFFFF == 402)
    });
    is_402 || (has(object::CONTROLWORD) && has(object::STATUSWORD))
}
