//! Values of the objects of a node as text, with their meanings.

use ecan_canopen::{
    DataType, DataValue, ErrorRegister, OperatingMode, Statusword, SupportedModes, error_code_text,
    object,
};
use serde_json::Value;

use super::device_type::DeviceType;
use super::node_client::unsigned;
use super::object_names::ObjectKey;

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
        let typed = data_type.and_then(|it| it.decode(&bytes).ok());
        let value = typed.unwrap_or_else(|| match bytes.len() {
            1..=8 => DataValue::Unsigned(unsigned(&bytes)),
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
        let number = unsigned(&self.bytes);
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
}
