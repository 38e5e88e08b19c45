//! Object dictionary of the built-in drive.

use ecan_canopen::{CobId, NodeId, OperatingMode, PdoCobId, SupportedModes, object};

use super::config::MotorConfig;
use super::data_type::DataType;
use super::dictionary::{Access, Object, Value};

/// Number of PDOs per direction.
pub(super) const PDO_COUNT: usize = 4;
/// Maximum number of objects in a PDO.
pub(super) const PDO_ENTRIES: usize = 8;

/// Scratch domain for transfer tests.
pub(super) const SCRATCH_DOMAIN: u16 = 0x2000;
/// Scratch text.
pub(super) const SCRATCH_TEXT: u16 = 0x2001;

const I8: DataType = DataType::Signed(1);
const I16: DataType = DataType::Signed(2);
const I32: DataType = DataType::Signed(4);
const U8: DataType = DataType::Unsigned(1);
const U16: DataType = DataType::Unsigned(2);
const U32: DataType = DataType::Unsigned(4);

fn object(
    (index, subindex): (u16, u8),
    data_type: DataType,
    access: Access,
    mappable: bool,
    value: i64,
) -> Object {
    let default = Value::Number(data_type.cut(value as u64));
    let value = default.clone();
    let limits = (None, None);
    Object { index, subindex, data_type, access, mappable, limits, default, saved: None, value }
}

fn bytes(index: u16, data_type: DataType, access: Access, value: &[u8]) -> Object {
    let default = Value::Bytes(value.to_vec());
    let value = default.clone();
    let limits = (None, None);
    let key = (index, 0);
    Object { default, value, limits, ..object(key, data_type, access, false, 0) }
}

/// A parameter.
fn parameter(index: u16, subindex: u8, data_type: DataType, value: i64) -> Object {
    object((index, subindex), data_type, Access::ReadWrite, false, value)
}

/// A constant.
fn constant(index: u16, subindex: u8, data_type: DataType, value: i64) -> Object {
    object((index, subindex), data_type, Access::Const, false, value)
}

/// A value that the drive updates; mappable.
fn actual(index: u16, data_type: DataType) -> Object {
    object((index, 0), data_type, Access::ReadOnly, true, 0)
}

/// A command to the drive; mappable.
fn command(index: u16, data_type: DataType) -> Object {
    object((index, 0), data_type, Access::ReadWriteOutput, true, 0)
}

fn limited(object: Object, low: i64, high: i64) -> Object {
    Object { limits: (Some(low), Some(high)), ..object }
}

pub(super) fn default_objects(node: NodeId, serial: u32, motor: &MotorConfig) -> Vec<Object> {
    let mut list = general(node, serial);
    for number in 0..PDO_COUNT as u8 {
        list.extend(receive_pdo(node, number));
        list.extend(transmit_pdo(node, number));
    }
    list.extend(profile(motor));
    list.extend(motion_parameters(motor));
    list.push(bytes(SCRATCH_DOMAIN, DataType::Domain, Access::ReadWrite, &[]));
    list.push(bytes(SCRATCH_TEXT, DataType::Text, Access::ReadWrite, b"simulated"));
    list
}

fn general(node: NodeId, serial: u32) -> Vec<Object> {
    let text = |index, text: &str| bytes(index, DataType::Text, Access::Const, text.as_bytes());
    let mut list = vec![
        // CiA 402 servo drive
        constant(object::DEVICE_TYPE, 0, U32, 0x0002_0192),
        actual(object::ERROR_REGISTER, U8),
        limited(parameter(object::ERROR_HISTORY, 0, U8, 0), 0, 0),
        parameter(object::SYNC_COB_ID, 0, U32, i64::from(CobId::SYNC.raw())),
        parameter(object::COMMUNICATION_CYCLE, 0, U32, 0),
        text(object::DEVICE_NAME, "ECAN simulated servo drive"),
        text(object::HARDWARE_VERSION, "1"),
        text(object::SOFTWARE_VERSION, env!("CARGO_PKG_VERSION")),
        constant(object::STORE_PARAMETERS, 0, U8, 1),
        parameter(object::STORE_PARAMETERS, 1, U32, 1),
        constant(object::RESTORE_PARAMETERS, 0, U8, 1),
        parameter(object::RESTORE_PARAMETERS, 1, U32, 1),
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
        constant(object::ERROR_BEHAVIOUR, 0, U8, 1),
        limited(parameter(object::ERROR_BEHAVIOUR, 1, U8, 0), 0, 2),
        constant(SDO_SERVER, 0, U8, 2),
        constant(SDO_SERVER, 1, U32, i64::from(CobId::sdo_client(node).raw())),
        constant(SDO_SERVER, 2, U32, i64::from(CobId::sdo_server(node).raw())),
    ];
    for subindex in 1..=super::emergency::HISTORY as u8 {
        let key = (object::ERROR_HISTORY, subindex);
        list.push(object(key, U32, Access::ReadOnly, false, 0));
    }
    list
}

/// SDO server parameter.
const SDO_SERVER: u16 = 0x1200;

/// Second object of PDO 2 to 4; the first is the controlword or statusword, in PDO 1 the only one.
const RECEIVED: [Option<(u16, u8)>; PDO_COUNT] = [
    None,
    Some((object::MODE_OF_OPERATION, 8)),
    Some((object::TARGET_POSITION, 32)),
    Some((object::TARGET_VELOCITY, 32)),
];
const SENT: [Option<(u16, u8)>; PDO_COUNT] = [
    None,
    Some((object::MODE_DISPLAY, 8)),
    Some((object::POSITION_ACTUAL, 32)),
    Some((object::VELOCITY_ACTUAL, 32)),
];

/// Only PDO 1 is valid by default.
fn cob_id(id: CobId, number: u8) -> i64 {
    let cob_id = PdoCobId::new(id.can_id());
    i64::from(if number == 0 { cob_id.raw() } else { cob_id.invalid().raw() })
}

fn mapping(index: u16, first: u16, second: Option<(u16, u8)>) -> Vec<Object> {
    let entry = |(index, bits)| i64::from(ecan_canopen::MappingEntry::new(index, 0, bits).raw());
    let count = 1 + i64::from(second.is_some());
    let mut list = vec![limited(parameter(index, 0, U8, count), 0, PDO_ENTRIES as i64)];
    for subindex in 1..=PDO_ENTRIES as u8 {
        let value = match subindex {
            1 => entry((first, 16)),
            2 => second.map_or(0, entry),
            _ => 0,
        };
        list.push(parameter(index, subindex, U32, value));
    }
    list
}

fn receive_pdo(node: NodeId, number: u8) -> Vec<Object> {
    let index = object::RPDO_COMMUNICATION + u16::from(number);
    let mut list = vec![
        constant(index, 0, U8, 5),
        parameter(index, 1, U32, cob_id(CobId::rpdo(node, number + 1), number)),
        parameter(index, 2, U8, 255),
        parameter(index, 5, U16, 0),
    ];
    let second = RECEIVED.get(usize::from(number)).copied().flatten();
    let index = object::RPDO_MAPPING + u16::from(number);
    list.extend(mapping(index, object::CONTROLWORD, second));
    list
}

fn transmit_pdo(node: NodeId, number: u8) -> Vec<Object> {
    let index = object::TPDO_COMMUNICATION + u16::from(number);
    let mut list = vec![
        constant(index, 0, U8, 6),
        parameter(index, 1, U32, cob_id(CobId::tpdo(node, number + 1), number)),
        parameter(index, 2, U8, if number == 0 { 255 } else { 1 }),
        parameter(index, 3, U16, 0),
        parameter(index, 5, U16, 0),
        limited(parameter(index, 6, U8, 0), 0, 240),
    ];
    let second = SENT.get(usize::from(number)).copied().flatten();
    let index = object::TPDO_MAPPING + u16::from(number);
    list.extend(mapping(index, object::STATUSWORD, second));
    list
}

fn profile(motor: &MotorConfig) -> Vec<Object> {
    let modes = OperatingMode::ALL
        .into_iter()
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
        constant(object::MAX_MOTOR_SPEED, 0, U32, rpm as i64),
        command(object::POSITION_OFFSET, I32),
        command(object::VELOCITY_OFFSET, I32),
        command(object::TORQUE_OFFSET, I16),
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

/// Motion parameters that must not be 0.
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
        let open = |object: &&mut Object| {
            object.key() == known.key() && object.default == Value::Number(0)
        };
        if let Some(object) = objects.iter_mut().find(open) {
            object.default = known.default.clone();
            object.value = known.default;
        }
    }
}
