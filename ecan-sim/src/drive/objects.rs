//! Objects of a node: built in, or those of a device file (EDS or DCF).

use std::sync::Arc;

use ecan_canopen::{
    AccessType, CobId, DataType, DataValue, DeviceFile, NodeId, ObjectEntry, OperatingMode,
    PdoCobId, SupportedModes, object,
};

use super::config::{DriveConfig, MotorConfig};
use super::dictionary::{Dictionary, MOST_AXES, Object, Value, axis_index};
use super::motion::INTERPOLATION_BUFFER;

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
            if let Self::File(file) = self {
                fill_in_unstated(&mut list, file, &default_objects(config));
            }
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

pub(super) const PDO_ENTRIES: usize = 8;

const I8: DataType = DataType::Integer8;
const I16: DataType = DataType::Integer16;
const I32: DataType = DataType::Integer32;
const U8: DataType = DataType::Unsigned8;
const U16: DataType = DataType::Unsigned16;
const U32: DataType = DataType::Unsigned32;

fn entry(key: (u16, u8), data_type: DataType, access: AccessType, value: i64) -> Object {
    Object::new(key, data_type, access, Value::Number(data_type.mask(value as u64)))
}

fn bytes(index: u16, data_type: DataType, access: AccessType, value: &[u8]) -> Object {
    Object::new((index, 0), data_type, access, Value::Bytes(value.to_vec()))
}

fn parameter(index: u16, subindex: u8, data_type: DataType, value: i64) -> Object {
    entry((index, subindex), data_type, AccessType::ReadWrite, value)
}

fn constant(index: u16, subindex: u8, data_type: DataType, value: i64) -> Object {
    entry((index, subindex), data_type, AccessType::Const, value)
}

/// A value that the drive updates; mappable.
fn actual(index: u16, data_type: DataType) -> Object {
    Object { mappable: true, ..entry((index, 0), data_type, AccessType::ReadOnly, 0) }
}

/// A command to the drive; mappable.
fn command(index: u16, data_type: DataType) -> Object {
    Object { mappable: true, ..entry((index, 0), data_type, AccessType::ReadWriteOutput, 0) }
}

fn limited(object: Object, low: i64, high: i64) -> Object {
    Object { limits: (Some(low), Some(high)), ..object }
}

pub(super) fn default_objects(config: &DriveConfig) -> Vec<Object> {
    let DriveConfig { node, serial, motor, .. } = config;
    let axes = usize::from(config.axes).clamp(1, MOST_AXES);
    let mut list = general(*node, *serial, axes);
    for (number, second) in (0..).zip(SECOND_OBJECTS) {
        list.extend(pdos(*node, number, second));
    }
    for axis in 0..axes {
        if axis > 0 {
            list.extend(axis_pdos(axis));
        }
        let objects = profile(motor).into_iter().chain(motion_parameters(motor));
        list.extend(
            objects.map(|object| Object { index: axis_index(axis, object.index), ..object }),
        );
        if axes > 1 {
            list.push(constant(axis_index(axis, AXIS_TYPE), 0, U32, DEVICE_TYPE));
        }
    }
    // scratch objects for transfer tests
    list.push(bytes(0x2000, DataType::Domain, AccessType::ReadWrite, &[]));
    list.push(bytes(0x2001, DataType::VisibleString, AccessType::ReadWrite, b"simulated"));
    list
}

fn general(node: NodeId, serial: u32, axes: usize) -> Vec<Object> {
    let text = |index, text: &str| {
        bytes(index, DataType::VisibleString, AccessType::Const, text.as_bytes())
    };
    let mut list = vec![
        constant(object::DEVICE_TYPE, 0, U32, if axes > 1 { SEVERAL_AXES } else { DEVICE_TYPE }),
        actual(object::ERROR_REGISTER, U8),
        limited(parameter(object::ERROR_HISTORY, 0, U8, 0), 0, 0),
        parameter(object::SYNC_COB_ID, 0, U32, i64::from(CobId::SYNC.raw())),
        parameter(object::COMMUNICATION_CYCLE, 0, U32, 0),
        text(object::DEVICE_NAME, "ECAN simulated servo drive"),
        text(object::HARDWARE_VERSION, "1"),
        text(object::SOFTWARE_VERSION, env!("CARGO_PKG_VERSION")),
        parameter(object::GUARD_TIME, 0, U16, 0),
        parameter(object::LIFE_TIME_FACTOR, 0, U8, 0),
        parameter(object::TIME_COB_ID, 0, U32, i64::from(CobId::TIME.raw())),
        parameter(object::EMCY_COB_ID, 0, U32, i64::from(CobId::emcy(node).raw())),
        parameter(object::EMCY_INHIBIT, 0, U16, 0),
        constant(object::CONSUMER_HEARTBEAT, 0, U8, 2),
        parameter(object::CONSUMER_HEARTBEAT, 1, U32, 0),
        parameter(object::CONSUMER_HEARTBEAT, 2, U32, 0),
        parameter(object::PRODUCER_HEARTBEAT, 0, U16, 0),
        constant(object::IDENTITY, 0, U8, 4),
        constant(object::IDENTITY, 1, U32, 0x5349_4D00),
        constant(object::IDENTITY, 2, U32, 402),
        constant(object::IDENTITY, 3, U32, 0x0001_0000),
        constant(object::IDENTITY, 4, U32, i64::from(serial)),
        limited(parameter(object::SYNC_COUNTER_OVERFLOW, 0, U8, 0), 0, 240),
        constant(object::CONFIGURATION_DATE, 0, U8, 2),
        parameter(object::CONFIGURATION_DATE, 1, U32, 0),
        parameter(object::CONFIGURATION_DATE, 2, U32, 0),
        constant(object::ERROR_BEHAVIOUR, 0, U8, 1),
        limited(parameter(object::ERROR_BEHAVIOUR, 1, U8, 0), 0, 2),
        constant(SDO_SERVER, 0, U8, 2),
        constant(SDO_SERVER, 1, U32, i64::from(CobId::sdo_client(node).raw())),
        constant(SDO_SERVER, 2, U32, i64::from(CobId::sdo_server(node).raw())),
        constant(object::PROGRAM_IDENTIFICATION, 0, U8, 1),
        constant(object::PROGRAM_IDENTIFICATION, 1, U32, 1),
    ];
    list.push(constant(object::SCANNER_LIST, 0, U8, SCANNER_ENTRIES));
    list.extend(
        (1..=SCANNER_ENTRIES as u8).map(|nth| parameter(object::SCANNER_LIST, nth, U32, 0)),
    );
    for index in [object::STORE_PARAMETERS, object::RESTORE_PARAMETERS] {
        list.push(constant(index, 0, U8, STORAGE_GROUPS));
        list.extend((1..=STORAGE_GROUPS as u8).map(|group| parameter(index, group, U32, 1)));
    }
    for subindex in 1..=super::network::HISTORY as u8 {
        let key = (object::ERROR_HISTORY, subindex);
        list.push(entry(key, U32, AccessType::ReadOnly, 0));
    }
    list
}

/// CiA 402 servo drive.
const DEVICE_TYPE: i64 = 0x0002_0192;
/// CiA 402, several axes.
const SEVERAL_AXES: i64 = 0xFFFF_0192;
/// Device type of an axis.
const AXIS_TYPE: u16 = 0x67FF;
/// PDOs of each axis (CiA 301, 7.5.1).
const PDOS_PER_AXIS: u16 = 64;
const SDO_SERVER: u16 = 0x1200;
/// All, communication, application and manufacturer parameters.
const STORAGE_GROUPS: i64 = 4;
const SCANNER_ENTRIES: i64 = 4;

/// Second objects of the four RPDOs and TPDOs, and their bits; the first is the controlword or
/// statusword, in PDO 1 the only one.
const SECOND_OBJECTS: [(u16, u16, u8); 4] = [
    (0, 0, 0),
    (object::MODE_OF_OPERATION, object::MODE_DISPLAY, 8),
    (object::TARGET_POSITION, object::POSITION_ACTUAL, 32),
    (object::TARGET_VELOCITY, object::VELOCITY_ACTUAL, 32),
];

/// Only PDO 1 is valid by default.
fn cob_id(id: CobId, number: u8) -> i64 {
    let cob_id = PdoCobId::new(id.can_id());
    i64::from(if number == 0 { cob_id.raw() } else { cob_id.invalid().raw() })
}

fn mapping(index: u16, first: u16, second: u16, bits: u8) -> Vec<Object> {
    let entry = |index, bits| i64::from(ecan_canopen::MappingEntry::new(index, 0, bits).raw());
    let count = if bits > 0 { 2 } else { 1 };
    let mut list = vec![parameter(index, 0, U8, count)];
    for subindex in 1..=PDO_ENTRIES as u8 {
        let value = match subindex {
            1 => entry(first, 16),
            2 => entry(second, bits),
            _ => 0,
        };
        list.push(parameter(index, subindex, U32, value));
    }
    list
}

fn pdos(node: NodeId, number: u8, (received, sent, bits): (u16, u16, u8)) -> Vec<Object> {
    let offset = u16::from(number);
    let receive = object::RPDO_COMMUNICATION + offset;
    let transmit = object::TPDO_COMMUNICATION + offset;
    let mut list = vec![
        constant(receive, 0, U8, 5),
        parameter(receive, 1, U32, cob_id(CobId::rpdo(node, number + 1), number)),
        parameter(receive, 2, U8, 255),
        parameter(receive, 5, U16, 0),
        constant(transmit, 0, U8, 6),
        parameter(transmit, 1, U32, cob_id(CobId::tpdo(node, number + 1), number)),
        parameter(transmit, 2, U8, if number == 0 { 255 } else { 1 }),
        parameter(transmit, 3, U16, 0),
        parameter(transmit, 5, U16, 0),
        limited(parameter(transmit, 6, U8, 0), 0, 240),
    ];
    list.extend(mapping(object::RPDO_MAPPING + offset, object::CONTROLWORD, received, bits));
    list.extend(mapping(object::TPDO_MAPPING + offset, object::STATUSWORD, sent, bits));
    list
}

/// The first PDO of a further axis in each direction; without a COB-ID.
fn axis_pdos(axis: usize) -> Vec<Object> {
    let offset = axis as u16 * PDOS_PER_AXIS;
    let (receive, transmit) =
        (object::RPDO_COMMUNICATION + offset, object::TPDO_COMMUNICATION + offset);
    let mut list = vec![
        constant(receive, 0, U8, 5),
        parameter(receive, 1, U32, NO_COB_ID),
        parameter(receive, 2, U8, 255),
        parameter(receive, 5, U16, 0),
        constant(transmit, 0, U8, 6),
        parameter(transmit, 1, U32, NO_COB_ID),
        parameter(transmit, 2, U8, 1),
        parameter(transmit, 3, U16, 0),
        parameter(transmit, 5, U16, 0),
        limited(parameter(transmit, 6, U8, 0), 0, 240),
    ];
    let index = |index| axis_index(axis, index);
    list.extend(mapping(object::RPDO_MAPPING + offset, index(object::CONTROLWORD), 0, 0));
    list.extend(mapping(object::TPDO_MAPPING + offset, index(object::STATUSWORD), 0, 0));
    list
}

/// A PDO that does not exist.
const NO_COB_ID: i64 = 1 << 31;

fn profile(motor: &MotorConfig) -> Vec<Object> {
    let modes = OperatingMode::ALL
        .iter()
        .copied()
        .filter(|mode| super::motion::is_supported(*mode))
        .fold(SupportedModes(0), SupportedModes::with);
    let rpm =
        u64::from(motor.max_velocity) * 60 / u64::from(motor.increments_per_revolution.max(1));
    vec![
        limited(parameter(object::ABORT_CONNECTION_OPTION, 0, I16, 1), 0, 3),
        actual(object::ERROR_CODE, U16),
        command(object::CONTROLWORD, U16),
        actual(object::STATUSWORD, U16),
        limited(parameter(object::QUICK_STOP_OPTION, 0, I16, 2), 0, 8),
        limited(parameter(object::SHUTDOWN_OPTION, 0, I16, 0), 0, 1),
        limited(parameter(object::DISABLE_OPERATION_OPTION, 0, I16, 1), 0, 1),
        limited(parameter(object::HALT_OPTION, 0, I16, 1), 1, 4),
        limited(parameter(object::FAULT_REACTION_OPTION, 0, I16, 2), 0, 4),
        command(object::MODE_OF_OPERATION, I8),
        actual(object::MODE_DISPLAY, I8),
        actual(object::POSITION_DEMAND, I32),
        actual(object::POSITION_ACTUAL_INTERNAL, I32),
        actual(object::POSITION_ACTUAL, I32),
        actual(object::VELOCITY_DEMAND, I32),
        actual(object::VELOCITY_ACTUAL, I32),
        command(object::TARGET_TORQUE, I16),
        actual(object::TORQUE_DEMAND, I16),
        constant(object::RATED_TORQUE, 0, U32, 1_000),
        actual(object::TORQUE_ACTUAL, I16),
        command(object::TARGET_POSITION, I32),
        limited(parameter(object::MAX_MOTOR_SPEED, 0, U32, rpm as i64), 1, rpm as i64),
        command(object::POSITION_OFFSET, I32),
        command(object::VELOCITY_OFFSET, I32),
        command(object::TORQUE_OFFSET, I16),
        command(object::VL_TARGET_VELOCITY, I16),
        actual(object::VL_VELOCITY_DEMAND, I16),
        actual(object::VL_VELOCITY_ACTUAL, I16),
        command(object::PROBE_FUNCTION, U16),
        actual(object::PROBE_STATUS, U16),
        actual(object::PROBE_1_POSITIVE, I32),
        actual(object::PROBE_1_NEGATIVE, I32),
        actual(object::PROBE_2_POSITIVE, I32),
        actual(object::PROBE_2_NEGATIVE, I32),
        constant(object::INTERPOLATION_DATA, 0, U8, 1),
        Object { subindex: 1, ..command(object::INTERPOLATION_DATA, I32) },
        constant(object::DIGITAL_OUTPUTS, 0, U8, 2),
        Object { subindex: 1, ..command(object::DIGITAL_OUTPUTS, U32) },
        parameter(object::DIGITAL_OUTPUTS, 2, U32, 0),
        actual(object::FOLLOWING_ERROR, I32),
        actual(object::DIGITAL_INPUTS, U32),
        command(object::TARGET_VELOCITY, I32),
        constant(object::SUPPORTED_MODES, 0, U32, i64::from(modes.0)),
    ]
}

/// Motion parameters, also used for those that an EDS leaves open.
fn motion_parameters(motor: &MotorConfig) -> Vec<Object> {
    let fastest = i64::from(motor.max_velocity);
    let strongest = i64::from(motor.max_acceleration);
    let increments = i64::from(motor.increments_per_revolution);
    vec![
        parameter(object::FOLLOWING_ERROR_WINDOW, 0, U32, increments / 2),
        parameter(object::FOLLOWING_ERROR_TIME, 0, U16, 10),
        parameter(object::POSITION_WINDOW, 0, U32, 100),
        parameter(object::POSITION_WINDOW_TIME, 0, U16, 5),
        parameter(object::VELOCITY_WINDOW, 0, U16, 1_000),
        parameter(object::MAX_TORQUE, 0, U16, i64::from(motor.max_torque)),
        parameter(object::HOME_OFFSET, 0, I32, 0),
        constant(object::SOFTWARE_POSITION_LIMIT, 0, U8, 2),
        parameter(object::SOFTWARE_POSITION_LIMIT, 1, I32, i64::from(i32::MIN)),
        parameter(object::SOFTWARE_POSITION_LIMIT, 2, I32, i64::from(i32::MAX)),
        limited(parameter(object::MAX_PROFILE_VELOCITY, 0, U32, fastest), 1, fastest),
        parameter(object::PROFILE_VELOCITY, 0, U32, fastest / 10),
        limited(parameter(object::PROFILE_ACCELERATION, 0, U32, strongest / 20), 1, strongest),
        limited(parameter(object::PROFILE_DECELERATION, 0, U32, strongest / 20), 1, strongest),
        limited(parameter(object::QUICK_STOP_DECELERATION, 0, U32, strongest / 4), 1, strongest),
        constant(object::ENCODER_RESOLUTION, 0, U8, 2),
        constant(object::ENCODER_RESOLUTION, 1, U32, increments),
        constant(object::ENCODER_RESOLUTION, 2, U32, 1),
        constant(object::GEAR_RATIO, 0, U8, 2),
        limited(parameter(object::GEAR_RATIO, 1, U32, 1), 1, i64::from(u32::MAX)),
        limited(parameter(object::GEAR_RATIO, 2, U32, 1), 1, i64::from(u32::MAX)),
        constant(object::FEED_CONSTANT, 0, U8, 2),
        limited(parameter(object::FEED_CONSTANT, 1, U32, increments), 1, i64::from(u32::MAX)),
        limited(parameter(object::FEED_CONSTANT, 2, U32, 1), 1, i64::from(u32::MAX)),
        // increments, and increments per second
        constant(object::SI_UNIT_POSITION, 0, U32, 0x00B5_0000),
        constant(object::SI_UNIT_VELOCITY, 0, U32, 0x00B5_0300),
        parameter(object::TORQUE_SLOPE, 0, U32, 10_000),
        constant(object::VL_VELOCITY_LIMITS, 0, U8, 2),
        parameter(object::VL_VELOCITY_LIMITS, 1, U32, 0),
        parameter(object::VL_VELOCITY_LIMITS, 2, U32, fastest * 60 / increments.max(1)),
        constant(object::VL_ACCELERATION, 0, U8, 2),
        parameter(object::VL_ACCELERATION, 1, U32, 6_000),
        parameter(object::VL_ACCELERATION, 2, U16, 1),
        constant(object::VL_DECELERATION, 0, U8, 2),
        parameter(object::VL_DECELERATION, 1, U32, 6_000),
        parameter(object::VL_DECELERATION, 2, U16, 1),
        limited(parameter(object::INTERPOLATION_MODE, 0, I16, 0), 0, 0),
        constant(object::INTERPOLATION_BUFFER, 0, U8, 6),
        constant(object::INTERPOLATION_BUFFER, 1, U32, INTERPOLATION_BUFFER as i64),
        limited(parameter(object::INTERPOLATION_BUFFER, 2, U32, 1), 1, INTERPOLATION_BUFFER as i64),
        limited(parameter(object::INTERPOLATION_BUFFER, 3, U8, 0), 0, 0),
        parameter(object::INTERPOLATION_BUFFER, 4, U16, 0),
        limited(parameter(object::INTERPOLATION_BUFFER, 5, U8, 4), 4, 4),
        limited(parameter(object::INTERPOLATION_BUFFER, 6, U8, 0), 0, 1),
        parameter(object::HOMING_METHOD, 0, I8, 37),
        constant(object::HOMING_SPEEDS, 0, U8, 2),
        limited(parameter(object::HOMING_SPEEDS, 1, U32, increments * 4), 1, fastest),
        limited(parameter(object::HOMING_SPEEDS, 2, U32, increments / 4), 1, fastest),
        limited(parameter(object::HOMING_ACCELERATION, 0, U32, strongest / 20), 1, strongest),
        constant(object::INTERPOLATION_TIME, 0, U8, 2),
        limited(parameter(object::INTERPOLATION_TIME, 1, U8, 1), 1, 255),
        limited(parameter(object::INTERPOLATION_TIME, 2, I8, -3), -6, 0),
    ]
}

const NEVER_ZERO: [(u16, u8); 10] = [
    (object::FOLLOWING_ERROR_WINDOW, 0),
    (object::PROFILE_VELOCITY, 0),
    (object::PROFILE_ACCELERATION, 0),
    (object::PROFILE_DECELERATION, 0),
    (object::QUICK_STOP_DECELERATION, 0),
    (object::ENCODER_RESOLUTION, 1),
    (object::ENCODER_RESOLUTION, 2),
    (object::HOMING_SPEEDS, 1),
    (object::HOMING_SPEEDS, 2),
    (object::HOMING_ACCELERATION, 0),
];

/// Replaces motion parameters of an EDS that must not be 0 by those of the built-in drive.
pub(super) fn fill_in(objects: &mut [Object], motor: &MotorConfig) {
    for known in motion_parameters(motor) {
        if !NEVER_ZERO.contains(&known.key()) {
            continue;
        }
        for axis in 0..MOST_AXES {
            let key = (axis_index(axis, known.index), known.subindex);
            let is_open =
                |object: &&mut Object| object.key() == key && object.default == Value::Number(0);
            if let Some(object) = objects.iter_mut().find(is_open) {
                object.default = known.default.clone();
                object.value = known.default.clone();
            }
        }
    }
}

/// Gives objects of the profile without a default in the file the value that they have in the built-in drive: a file
/// may leave out what its devices differ in.
fn fill_in_unstated(objects: &mut [Object], file: &DeviceFile, built_in: &[Object]) {
    for object in objects {
        let (index, subindex) = object.key();
        let is_open = file.entry(index, subindex).is_some_and(|entry| entry.default.is_none());
        if is_open
            && matches!(index, object::DEVICE_TYPE | 0x6000..=0x67FF)
            && let Some(known) = built_in.iter().find(|known| known.key() == (index, subindex))
        {
            object.default = known.default.clone();
            let saved = object.saved.clone();
            object.value = saved.unwrap_or_else(|| known.default.clone());
        }
    }
}

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
