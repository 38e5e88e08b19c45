//! Values of the objects of a node as text with their meanings, its device type and its motion objects.

use std::fmt;

use ecan_canopen::{
    DataType, DataValue, ErrorRegister, OperatingMode, Statusword, SupportedModes, error_code_text,
    object,
};
use serde_json::Value;

use super::node_client::decode_unsigned;
use super::objects::ObjectKey;

/// Bytes of an object, with its type if it is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectValue {
    pub bytes: Vec<u8>,
    value: DataValue,
}

impl ObjectValue {
    /// Decodes the bytes by a type; without one, or of another length, as an unsigned number or as
    /// bytes.
    pub fn new(bytes: Vec<u8>, data_type: Option<DataType>) -> Self {
        let typed = data_type.and_then(|data_type| data_type.decode(&bytes).ok());
        let value = typed.unwrap_or_else(|| match bytes.len() {
            1..=8 => DataValue::Unsigned(decode_unsigned(&bytes)),
            _ => DataValue::Bytes(bytes.clone()),
        });
        Self { bytes, value }
    }

    /// `1007 (0x3EF)`, `"text"`.
    pub fn text(&self) -> String {
        match &self.value {
            DataValue::Unsigned(value) if *value > 9 => format!("{value} (0x{value:X})"),
            DataValue::Text(text) => format!("\"{text}\""),
            DataValue::Bytes(bytes) if bytes.is_empty() => "no bytes".to_owned(),
            value => value.to_string(),
        }
    }

    /// The value in JSON: a number or a text; null for bytes.
    pub fn json(&self) -> Value {
        match &self.value {
            DataValue::Boolean(value) => (*value).into(),
            DataValue::Signed(value) => (*value).into(),
            DataValue::Unsigned(value) => (*value).into(),
            DataValue::Real32(value) => (*value).into(),
            DataValue::Real64(value) => (*value).into(),
            DataValue::Text(text) => text.clone().into(),
            DataValue::Bytes(_) => Value::Null,
            time @ DataValue::Time { .. } => time.to_string().into(),
        }
    }

    /// Meaning of the value of an object of CiA 301 or CiA 402; of drives with several axes also of
    /// the second and further ones (offset 0x800).
    pub fn meaning(&self, (index, subindex): ObjectKey) -> Option<String> {
        let number = decode_unsigned(&self.bytes);
        let index = match index {
            0x6800..=0x9FFF => 0x6000 + (index - 0x6000) % 0x800,
            index => index,
        };
        match (index, subindex) {
            (object::DEVICE_TYPE, 0) => Some(DeviceType(number as u32).to_string()),
            (object::ERROR_REGISTER, 0) => Some(ErrorRegister(number as u8).to_string()),
            (object::ERROR_HISTORY, 1..) => Some(error_text(number as u16)),
            (object::ERROR_CODE, 0) => Some(error_text(number as u16)),
            (object::STATUSWORD, 0) => Some(status_text(Statusword(number as u16))),
            (object::MODE_OF_OPERATION | object::MODE_DISPLAY, 0) => {
                OperatingMode::from_raw(number as i8).map(|mode| mode.to_string())
            }
            (object::SUPPORTED_MODES, 0) => Some(modes_text(SupportedModes(number as u32))),
            _ => None,
        }
    }
}

/// Meaning of an error code, with its class if it is not named.
pub fn error_text(code: u16) -> String {
    match error_code_text(code) {
        Some(text) => text.to_owned(),
        None => format!("not named by CiA; class: {}", ecan_canopen::EmcyClass::of(code)),
    }
}

/// State of the drive in the statusword.
pub fn status_text(status: Statusword) -> String {
    let state = status.state();
    state.map_or_else(|| "no state of CiA 402".to_owned(), |state| state.to_string())
}

/// `PP, PV, CSP`.
pub fn modes_text(modes: SupportedModes) -> String {
    let all = (1..=10).filter_map(OperatingMode::from_raw).filter(|mode| modes.contains(*mode));
    let names: Vec<_> = all.map(|mode| mode.to_string()).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// Value of 0x1000.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceType(pub u32);

impl DeviceType {
    /// Number of the device profile, for example 402; 0 without one.
    pub fn profile(self) -> u16 {
        self.0 as u16
    }

    pub fn is_drive(self) -> bool {
        self.profile() == 402
    }
}

/// Names of device profiles.
const PROFILES: [(u16, &str); 12] = [
    (401, "I/O module"),
    (402, "drive"),
    (404, "measuring device or controller"),
    (405, "programmable controller"),
    (406, "encoder"),
    (408, "proportional valve"),
    (410, "inclinometer"),
    (412, "medical device"),
    (413, "truck gateway"),
    (417, "lift control"),
    (418, "battery module"),
    (419, "battery charger"),
];

/// Kinds of drives: bits 16 to 23.
const DRIVES: [(u8, &str); 4] = [
    (0x01, "frequency converter"),
    (0x02, "servo drive"),
    (0x04, "stepper motor drive"),
    (0x08, "drive with several axes"),
];

impl fmt::Display for DeviceType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let profile = self.profile();
        if profile == 0 {
            return f.write_str("no device profile");
        }
        let name = PROFILES.iter().find(|known| known.0 == profile).map(|known| known.1);
        match name {
            Some("drive") => {
                let kind = (self.0 >> 16) as u8;
                let kind =
                    DRIVES.iter().find(|known| known.0 == kind).map_or("drive", |known| known.1);
                write!(f, "{kind} (CiA {profile})")
            }
            Some(name) => write!(f, "{name} (CiA {profile})"),
            None => write!(f, "device profile CiA {profile}"),
        }
    }
}

/// Targets of the modes that have no constant elsewhere: 0x6042 (vl), 0x60C1 (ip).
const VL_TARGET_VELOCITY: u16 = 0x6042;
const INTERPOLATION_DATA: u16 = 0x60C1;
/// Distance of the objects of the axes of a drive (CiA 402-2, 5).
const AXIS_OFFSET: u16 = 0x800;

/// Returns whether a write can start, stop or change a motion: controlword, mode and targets of any
/// of the 8 axes, and the outputs.
pub fn moves_a_motor(index: u16) -> bool {
    if !(0x6000..0xA000).contains(&index) {
        return false;
    }
    matches!(
        0x6000 + (index - 0x6000) % AXIS_OFFSET,
        object::CONTROLWORD
            | VL_TARGET_VELOCITY
            | object::MODE_OF_OPERATION
            | object::TARGET_TORQUE
            | object::TARGET_POSITION
            | object::TARGET_VELOCITY
            | object::POSITION_OFFSET
            | object::VELOCITY_OFFSET
            | object::TORQUE_OFFSET
            | INTERPOLATION_DATA
            | DIGITAL_OUTPUTS
    )
}

/// Digital outputs, among them the brake.
const DIGITAL_OUTPUTS: u16 = 0x60FE;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_types_and_meanings() {
        let value = |bytes: &[u8], ty| ObjectValue::new(bytes.to_vec(), ty);
        let position = value(&[0x9C, 0xFF, 0xFF, 0xFF], Some(DataType::Integer32));
        assert_eq!((position.text(), position.json()), ("-100".into(), (-100).into()));
        assert_eq!(value(b"drive\0", Some(DataType::VisibleString)).text(), "\"drive\"");
        assert_eq!(value(&[1, 2, 3], None).text(), "197121 (0x30201)");
        assert_eq!(value(&[0; 9], None).text(), "00 00 00 00 00 00 00 00 00");
        // The node has another type than the file: the number is shown.
        assert_eq!(value(&[7, 0], Some(DataType::Unsigned32)).text(), "7");
        let meaning = |bytes: &[u8], index| value(bytes, None).meaning((index, 0));
        assert_eq!(meaning(&[0x37, 0x06], 0x6041).unwrap(), "operation enabled");
        assert_eq!(meaning(&[0x37, 0x06], 0x6841).unwrap(), "operation enabled", "second axis");
        assert_eq!(meaning(&[8], 0x6061).unwrap(), "CSP");
        assert_eq!(
            meaning(&[0x10, 0x23], 0x603F).unwrap(),
            "continuous over-current at the output"
        );
        assert_eq!(meaning(&[0x77, 0x23], 0x603F).unwrap(), "not named by CiA; class: current");
        assert_eq!(meaning(&[0xA5, 0, 0, 0], 0x6502).unwrap(), "PP, PV, HM, CSP");
        assert_eq!(meaning(&[1], 0x6040), None);
    }

    #[test]
    fn profiles_have_names() {
        assert_eq!(DeviceType(0x0002_0192).to_string(), "servo drive (CiA 402)");
        assert_eq!(DeviceType(0x0004_0192).to_string(), "stepper motor drive (CiA 402)");
        assert_eq!(DeviceType(0x000F_0191).to_string(), "I/O module (CiA 401)");
        assert_eq!(DeviceType(0x0000_01F4).to_string(), "device profile CiA 500");
        assert_eq!(DeviceType(0).to_string(), "no device profile");
        assert!(DeviceType(0x0192).is_drive() && !DeviceType(0x0191).is_drive());
    }

    #[test]
    fn objects_of_every_axis_are_covered() {
        for index in [0x6040, 0x6060, 0x607A, 0x60FF, 0x6071, 0x6840, 0x9840, 0x60B1, 0x60FE] {
            assert!(moves_a_motor(index), "{index:04X}");
        }
        for index in [0x1017, 0x6041, 0x6081, 0x2000, 0xA040, 0x5040] {
            assert!(!moves_a_motor(index), "{index:04X}");
        }
    }
}
