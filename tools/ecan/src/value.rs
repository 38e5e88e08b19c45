//! Conversion of object values between text and bytes, with units and meanings; values that other firmware versions
//! lack.

use ecan_host::Error;
use ecan_protocol::object::{Entry, ObjectType};
use ecan_protocol::text::Printable;
use serde::{Serialize, Serializer};

use crate::context::{Failure, Result};

/// Parses an unsigned number, decimal or hexadecimal with 0x.
pub fn parse_unsigned(text: &str) -> Option<u64> {
    match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => u64::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

/// Rejects an index without 0x that is a known object only as a hexadecimal number: `8010`.
pub fn reject_without_prefix(text: &str, is_known: impl Fn(u16) -> bool) -> Result<(), String> {
    let Some(meant) = u16::from_str_radix(text, 16).ok().filter(|value| is_known(*value)) else {
        return Ok(());
    };
    match text.parse::<u16>() {
        Ok(read) if is_known(read) => Ok(()),
        Ok(read) => Err(format!(
            "{text} is read as the decimal number of 0x{read:04X}, which is no known object; for \
             the hexadecimal index 0x{meant:04X} write 0x{text}, or 0x{read:04X} for the other"
        )),
        Err(_) => Err(format!("index {text} has no prefix; for 0x{meant:04X} write 0x{text}")),
    }
}

/// Value of an object. In JSON a number, a text, or null for bytes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Value {
    Unsigned(u64),
    Signed(i64),
    Text(String),
    #[serde(serialize_with = "nothing")]
    Bytes(Vec<u8>),
}

fn nothing<S: Serializer>(_: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_none()
}

impl Value {
    /// Decodes the bytes of a known entry, or of one that is not in the table.
    pub fn of(bytes: &[u8], entry: Option<&Entry>) -> Self {
        let mut number = [0; 8];
        let is_number = bytes.len() <= number.len() && !bytes.is_empty();
        match entry.map(|entry| entry.ty) {
            Some(ObjectType::VisibleString) => {
                let text = String::from_utf8_lossy(bytes);
                Self::Text(text.trim_end_matches('\0').to_owned())
            }
            Some(ObjectType::String16) => Self::Bytes(bytes.to_vec()),
            ty if is_number => {
                number[..bytes.len()].copy_from_slice(bytes);
                let value = u64::from_le_bytes(number);
                match ty {
                    Some(ObjectType::I32) => Self::Signed((value as u32 as i32).into()),
                    _ => Self::Unsigned(value),
                }
            }
            _ => Self::Bytes(bytes.to_vec()),
        }
    }

    pub fn text(&self, entry: Option<&Entry>) -> String {
        let unit = entry.and_then(|entry| entry.unit).map_or_else(String::new, |unit| {
            let factor = if unit.starts_with(|c: char| c.is_ascii_digit()) { "x " } else { "" };
            format!(" {factor}{unit}")
        });
        match self {
            Self::Unsigned(value) if *value > 9 => format!("{value}{unit} (0x{value:X})"),
            Self::Unsigned(value) => format!("{value}{unit}"),
            Self::Signed(value) => format!("{value}{unit}"),
            Self::Text(text) => format!("\"{}\"", Printable(text)),
            Self::Bytes(bytes) => {
                let bytes: Vec<_> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
                bytes.join(" ")
            }
        }
    }

    /// Returns the meaning of the value from the table: a name, or the names of the set bits.
    pub fn meaning(&self, entry: Option<&Entry>) -> Option<String> {
        let (Self::Unsigned(value), Some(entry)) = (self, entry) else { return None };
        let value = u32::try_from(*value).ok()?;
        if let Some((_, word)) = entry.values.iter().find(|(number, _)| *number == value) {
            return Some((*word).to_owned());
        }
        let bits: Vec<_> = entry
            .bits
            .iter()
            .filter(|(bit, _)| {
                value.checked_shr((*bit).into()).is_some_and(|shifted| shifted & 1 == 1)
            })
            .map(|(_, word)| *word)
            .collect();
        (!bits.is_empty()).then(|| bits.join(", "))
    }
}

pub fn encode(
    text: &str,
    entry: Option<&Entry>,
    ty: Option<ObjectType>,
) -> Result<Vec<u8>, String> {
    let Some(ty) = ty.or(entry.map(|entry| entry.ty)) else {
        return Err("the object is not in the table; set its type with --type".to_owned());
    };
    match ty {
        ObjectType::VisibleString => Ok(text.as_bytes().to_vec()),
        ObjectType::String16 => Err("PDO image chunks cannot be written as text".to_owned()),
        ObjectType::I32 => {
            let value: i32 = text.parse().map_err(|_| format!("invalid integer \"{text}\""))?;
            Ok(value.to_le_bytes().to_vec())
        }
        ObjectType::U8 | ObjectType::U16 | ObjectType::U32 => {
            let word = entry.and_then(|entry| {
                let is_it = |(_, word): &&(u32, &str)| word.eq_ignore_ascii_case(text);
                entry.values.iter().find(is_it).map(|(number, _)| u64::from(*number))
            });
            let value = parse_unsigned(text).or(word).ok_or_else(|| {
                let names: Vec<_> =
                    entry.iter().flat_map(|object| object.values).map(|(_, name)| *name).collect();
                match &names[..] {
                    [] => format!("invalid number \"{text}\""),
                    names => format!(
                        "invalid value \"{text}\"; allowed: a number or {}",
                        names.join(", ")
                    ),
                }
            })?;
            let bytes = ty.size_bytes().unwrap_or(4);
            if value > u64::from(ty.max_value()) {
                return Err(format!("{value} is out of range; allowed: 0 to {}", ty.max_value()));
            }
            Ok(value.to_le_bytes().get(..bytes).unwrap_or_default().to_vec())
        }
    }
}

#[derive(Debug, Default)]
pub struct Readings {
    read: usize,
    unanswered: usize,
    first: Option<Failure>,
}

impl Readings {
    /// Counts a result; returns the value or the reason why it is missing.
    pub fn note<T>(&mut self, reading: Result<T>) -> Result<T, String> {
        let failure = match reading {
            Ok(value) => {
                self.read += 1;
                return Ok(value);
            }
            Err(failure) => failure,
        };
        let reason = match &failure {
            Failure::Device(Error::Sdo { abort_code: Some(code), .. }) => code.to_string(),
            Failure::Device(Error::Sdo { errno, .. }) => {
                self.unanswered += 1;
                errno.to_string()
            }
            other => {
                self.unanswered += 1;
                other.to_string()
            }
        };
        self.first.get_or_insert(failure);
        Err(reason)
    }

    /// Checks whether to continue: each request to a slave that does not respond takes as long as
    /// the mailbox timeout of the master.
    pub fn answers(&mut self) -> Result {
        match self.first.take_if(|_| self.read == 0 && self.unanswered > 0) {
            Some(first) => Err(first),
            None => Ok(()),
        }
    }

    /// Checks whether there is anything to print.
    pub fn any(&mut self) -> Result {
        match self.first.take() {
            Some(first) if self.read == 0 => Err(first),
            _ => Ok(()),
        }
    }

    /// Checks whether the slave responded to every request, at least with an abort code.
    pub fn end(&self) -> Result {
        match self.unanswered {
            0 => Ok(()),
            1 => Err(Failure::Rejected("1 value was not read; see above".to_owned())),
            more => Err(Failure::Rejected(format!("{more} values were not read; see above"))),
        }
    }
}

pub fn not_read(reason: &str) -> String {
    format!("not read: {reason}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(index: u16, subindex: u8) -> &'static Entry {
        ecan_protocol::object::object(index).unwrap().entry(subindex).unwrap()
    }

    #[test]
    fn values_have_units_and_meanings() {
        let mode = entry(0xB000, 1);
        let value = Value::of(&[1], Some(mode));
        assert_eq!(
            (value.text(Some(mode)), value.meaning(Some(mode))),
            ("1".into(), Some("engineering".into()))
        );
        let flags = entry(0xB000, 6);
        let value = Value::of(&[0x50, 0], Some(flags));
        assert_eq!(value.meaning(Some(flags)).unwrap(), "TX_RING_DROP, SCHED_LATE_DROP");
        let timeout = entry(0xB000, 3);
        assert_eq!(Value::of(&[60, 0], Some(timeout)).text(Some(timeout)), "60 s (0x3C)");
        let phase = entry(0x9011, 4);
        assert_eq!(Value::of(&[0xFE, 0xFF, 0xFF, 0xFF], Some(phase)), Value::Signed(-2));
        assert_eq!(Value::of(b"1.2\0", Some(entry(0x100A, 0))).text(None), "\"1.2\"");
        assert_eq!(Value::of(&[0; 9], None).text(None), "00 00 00 00 00 00 00 00 00");
    }

    #[test]
    fn encode_accepts_names_and_numbers() {
        let mode = Some(entry(0xB000, 1));
        assert_eq!(encode("factory", mode, None), Ok(vec![2]));
        assert_eq!(encode("0x2", mode, None), Ok(vec![2]));
        assert!(encode("off", mode, None).unwrap_err().contains("a number or run, engineering"));
        assert!(encode("256", mode, None).unwrap_err().contains("allowed: 0 to 255"));
        assert!(encode("1", None, None).unwrap_err().contains("--type"));
        assert_eq!(encode("1", None, Some(ObjectType::U16)), Ok(vec![1, 0]));
    }
}
