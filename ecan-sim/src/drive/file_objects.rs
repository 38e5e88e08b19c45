//! Objects of a device file (EDS or DCF).

use ecan_canopen::{DataType, DataValue, DeviceFile, NodeId, ObjectEntry, object};

use super::dictionary::{Object, Value};

/// The objects of a file for a node. A `ParameterValue` is as a value saved with 0x1010: it counts
/// after a reset, until the defaults are restored.
pub(super) fn file_objects(file: &DeviceFile, node: NodeId, serial: u32) -> Vec<Object> {
    let mut objects: Vec<_> = file.entries().map(|entry| object_of(entry, node)).collect();
    // A file describes all devices of a type, except their serial numbers.
    let is_open = |object: &&mut Object| {
        object.key() == (object::IDENTITY, 4) && object.value == Value::Number(0)
    };
    if let Some(object) = objects.iter_mut().find(is_open) {
        object.default = Value::Number(serial.into());
        object.value = Value::Number(serial.into());
    }
    objects
}

fn object_of(entry: &ObjectEntry, node: NodeId) -> Object {
    let data_type = entry.data_type;
    let value = |value: &DataValue| value_of(data_type, value);
    let default = match entry.default_value(node) {
        Some(default) => value(&default),
        None if data_type.size().is_some() => Value::Number(0),
        None => Value::Bytes(Vec::new()),
    };
    let saved = entry.parameter_value(node).map(|parameter| value(&parameter));
    let limit = |limit: Option<DataValue>| {
        let number = limit.filter(|_| data_type.is_integer())?.to_integer()?;
        i64::try_from(number).ok()
    };
    let (low, high) = entry.limits(node);
    Object {
        mappable: entry.pdo_mapping,
        limits: (limit(low), limit(high)),
        value: saved.clone().unwrap_or_else(|| default.clone()),
        saved,
        ..Object::new((entry.index, entry.subindex), data_type, entry.access, default)
    }
}

/// A value that the type cannot hold is empty.
fn value_of(data_type: DataType, value: &DataValue) -> Value {
    let bytes = data_type.encode(value).unwrap_or_default();
    match data_type.size() {
        Some(_) => {
            Value::Number(bytes.iter().rev().fold(0, |raw, byte| raw << 8 | u64::from(*byte)))
        }
        None => Value::Bytes(bytes),
    }
}
