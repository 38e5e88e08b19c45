//! Values of CANopen objects as text.

use std::str::FromStr;

/// Type of a value on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValueType {
    /// Unsigned, with this number of bytes.
    Unsigned(usize),
    /// Signed, with this number of bytes.
    Signed(usize),
    /// Text.
    Text,
    /// Bytes in hexadecimal.
    Hex,
    /// Unknown: shown in all formats that fit the length.
    Any,
}

impl FromStr for ValueType {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Ok(match text {
            "u8" => Self::Unsigned(1),
            "u16" => Self::Unsigned(2),
            "u32" => Self::Unsigned(4),
            "u64" => Self::Unsigned(8),
            "i8" => Self::Signed(1),
            "i16" => Self::Signed(2),
            "i32" => Self::Signed(4),
            "i64" => Self::Signed(8),
            "string" => Self::Text,
            "hex" => Self::Hex,
            _ => return Err("expected u8, u16, u32, u64, i8, i16, i32, i64, string or hex".into()),
        })
    }
}

fn parse_integer(text: &str) -> Option<i128> {
    let (negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text),
    };
    let magnitude = match digits.strip_prefix("0x") {
        Some(digits) => i128::from_str_radix(digits, 16).ok()?,
        None => digits.parse().ok()?,
    };
    Some(if negative { -magnitude } else { magnitude })
}

impl ValueType {
    /// Converts a text to the bytes of the value, little-endian.
    ///
    /// # Errors
    /// The text is not a value of the type; the message gives the allowed range.
    pub fn encode(self, text: &str) -> Result<Vec<u8>, String> {
        let integer = |bytes: usize, low: i128, high: i128| {
            let value = parse_integer(text).filter(|value| (low..=high).contains(value));
            match value {
                Some(value) => Ok(value.to_le_bytes()[..bytes].to_vec()),
                None => Err(format!("invalid number {text}; allowed: {low} to {high}")),
            }
        };
        match self {
            Self::Unsigned(bytes) => integer(bytes, 0, (1 << (8 * bytes)) - 1),
            Self::Signed(bytes) => {
                let half: i128 = 1 << (8 * bytes - 1);
                integer(bytes, -half, half - 1)
            }
            Self::Text | Self::Any => Ok(text.as_bytes().to_vec()),
            Self::Hex => {
                let digits: Vec<u32> = text.chars().filter_map(|c| c.to_digit(16)).collect();
                let count = text.chars().filter(|c| !c.is_whitespace()).count();
                if digits.len() != count || count % 2 != 0 {
                    return Err(format!(
                        "invalid bytes {text}; expected pairs of hexadecimal digits"
                    ));
                }
                Ok(digits.chunks(2).map(|pair| (pair[0] * 16 + pair[1]) as u8).collect())
            }
        }
    }

    /// Converts a value to text.
    ///
    /// # Errors
    /// The value has a different length than the type.
    pub fn show(self, data: &[u8]) -> Result<String, String> {
        match self {
            Self::Unsigned(bytes) | Self::Signed(bytes) if data.len() != bytes => {
                Err(format!("the value has {} bytes, expected {bytes}: {}", data.len(), hex(data)))
            }
            Self::Unsigned(_) => {
                let value = unsigned(data);
                Ok(format!("{value} (0x{value:0width$X})", width = 2 * data.len()))
            }
            Self::Signed(_) => Ok(signed(data).to_string()),
            Self::Text => Ok(format!("{:?}", String::from_utf8_lossy(data))),
            Self::Hex => Ok(hex(data)),
            Self::Any => Ok(any(data)),
        }
    }
}

fn hex(data: &[u8]) -> String {
    let bytes: Vec<String> = data.iter().map(|byte| format!("{byte:02X}")).collect();
    bytes.join(" ")
}

fn unsigned(data: &[u8]) -> u64 {
    data.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
}

fn signed(data: &[u8]) -> i64 {
    let unused = 64 - 8 * data.len().min(8) as u32;
    if data.is_empty() { 0 } else { ((unsigned(data) << unused) as i64) >> unused }
}

fn any(data: &[u8]) -> String {
    let is_text = data.len() > 4 && data.iter().all(|byte| (b' '..=b'~').contains(byte));
    match data.len() {
        _ if is_text => format!("{:?}", String::from_utf8_lossy(data)),
        1 | 2 | 4 | 8 => {
            let (value, width) = (unsigned(data), 2 * data.len());
            let negative = signed(data);
            let sign = if negative < 0 { format!(", signed {negative}") } else { String::new() };
            format!("0x{value:0width$X} ({value}{sign}), {} byte(s)", data.len())
        }
        length => format!("{} ({length} byte(s))", hex(data)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_width_and_sign() {
        assert_eq!(ValueType::Unsigned(2).encode("0x1234").unwrap(), [0x34, 0x12]);
        assert_eq!(ValueType::Signed(4).encode("-2").unwrap(), [0xFE, 0xFF, 0xFF, 0xFF]);
        assert_eq!(ValueType::Signed(1).show(&[0xFF]).unwrap(), "-1");
        assert_eq!(ValueType::Unsigned(1).show(&[8]).unwrap(), "8 (0x08)");
        for (kind, wrong) in [
            (ValueType::Unsigned(1), "256"),
            (ValueType::Signed(1), "-129"),
            (ValueType::Hex, "abc"),
        ] {
            assert!(kind.encode(wrong).is_err(), "{wrong}");
        }
        assert_eq!(ValueType::Hex.encode("00 ff").unwrap(), [0, 0xFF]);
        assert!(ValueType::Unsigned(4).show(&[1]).unwrap_err().contains("1 bytes, expected 4"));
    }
}
