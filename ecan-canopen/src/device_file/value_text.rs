//! Values as text: literals of CiA 306-1 and sums with `$NODEID`.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use super::data_type::{DataType, ValueClass};
use super::data_value::{DataValue, FileValue, TIME_MASK, ValueError};

/// A deviation in the text of a value, which nevertheless has a meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ValueNote {
    /// The number is outside the range of the type, but has the bits of one.
    TakenAsBits,
    /// A leading zero announces an octal number, but there are other digits.
    TakenAsDecimal,
    /// A comment follows the value.
    CommentRemoved,
    /// The number has a suffix of the language C.
    SuffixRemoved,
    /// `NODEID` has no `$`.
    TakenAsNodeId,
    /// A BOOLEAN is a word.
    TakenAsBoolean,
}

impl ValueNote {
    /// Description of the reading.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::TakenAsBits => "out of range, read as the bits of the value",
            Self::TakenAsDecimal => "invalid octal number, read as decimal",
            Self::CommentRemoved => "comment after the value ignored",
            Self::SuffixRemoved => "suffix of C ignored",
            Self::TakenAsNodeId => "read as $NODEID",
            Self::TakenAsBoolean => "read as BOOLEAN",
        }
    }
}

/// Integer literal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Literal {
    pub(super) value: i128,
    /// Written in hexadecimal: the digits may be the bits of a negative number.
    is_hexadecimal: bool,
    pub(super) note: Option<ValueNote>,
}

/// Reads a decimal, hexadecimal (`0x`) or octal (leading `0`) number with an optional sign.
pub(super) fn literal(text: &str) -> Option<Literal> {
    let text = text.trim();
    let (is_negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let hexadecimal = digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X"));
    let is_octal = digits.len() > 1 && digits.starts_with('0');
    let (radix, digits, note) = match hexadecimal {
        Some(digits) => (16, digits, None),
        None if is_octal && digits.contains(['8', '9']) => {
            (10, digits, Some(ValueNote::TakenAsDecimal))
        }
        None if is_octal => (8, digits, None),
        None => (10, digits, None),
    };
    let number = digits.trim_end_matches(['u', 'U', 'l', 'L']);
    let note = if number.len() < digits.len() { Some(ValueNote::SuffixRemoved) } else { note };
    let digits = number;
    // from_str_radix would accept a second sign.
    if digits.starts_with(['+', '-']) {
        return None;
    }
    let value = i128::from(u64::from_str_radix(digits, radix).ok()?);
    let value = if is_negative { -value } else { value };
    Some(Literal { value, is_hexadecimal: hexadecimal.is_some(), note })
}

/// Reads a number of a description (an index, a count, a flag); a comment after it is ignored.
pub(super) fn number(text: &str) -> Option<i128> {
    literal(text).or_else(|| literal(without_comment(text)?)).map(|literal| literal.value)
}

fn without_comment(text: &str) -> Option<&str> {
    text.split_once(';').map(|(value, _)| value.trim_end())
}

/// Reads a value of a type from the text of a file.
pub(super) fn read(
    data_type: DataType,
    text: &str,
) -> Result<(FileValue, Option<ValueNote>), ValueError> {
    let error = match read_plain(data_type, text) {
        // A file cannot hold an empty value: `0x` alone is none.
        Ok((FileValue::Fixed(DataValue::Bytes(bytes)), _)) if bytes.is_empty() => {
            ValueError::NotBytes { text: text.into() }
        }
        Err(error) => error,
        value => return value,
    };
    let has_numbers = !matches!(data_type.class(), ValueClass::Text);
    match without_comment(text).filter(|_| has_numbers).map(|text| read_plain(data_type, text)) {
        Some(Ok((value, note))) if value != FileValue::Fixed(DataValue::Bytes(Vec::new())) => {
            Ok((value, note.or(Some(ValueNote::CommentRemoved))))
        }
        _ => Err(error),
    }
}

fn read_plain(
    data_type: DataType,
    text: &str,
) -> Result<(FileValue, Option<ValueNote>), ValueError> {
    let fixed = |value| (FileValue::Fixed(value), None);
    Ok(match data_type.class() {
        ValueClass::Boolean | ValueClass::Signed | ValueClass::Unsigned => {
            return integer(data_type, text);
        }
        ValueClass::Real => fixed(real(data_type, text)?),
        ValueClass::Text => {
            let value = DataValue::Text(text.into());
            data_type.encode(&value)?;
            fixed(value)
        }
        ValueClass::Time => {
            if let Some(value) = time(text) {
                return Ok(fixed(value));
            }
            let not_a_number = || ValueError::NotANumber { text: text.into() };
            let raw = literal(text).ok_or_else(not_a_number)?.value;
            let high = (1 << 48) - 1;
            if !(0..=high).contains(&raw) {
                return Err(ValueError::OutOfRange { text: text.into(), data_type, low: 0, high });
            }
            let (days, milliseconds) = ((raw >> 32) as u16, raw as u32 & TIME_MASK);
            fixed(DataValue::Time { days, milliseconds })
        }
        ValueClass::Bytes => fixed(DataValue::Bytes(bytes(text)?)),
    })
}

fn integer(data_type: DataType, text: &str) -> Result<(FileValue, Option<ValueNote>), ValueError> {
    let not_a_number = || ValueError::NotANumber { text: text.into() };
    if data_type == DataType::Boolean
        && let Some(value) = boolean_word(text)
    {
        let value = FileValue::Fixed(DataValue::Boolean(value));
        return Ok((value, Some(ValueNote::TakenAsBoolean)));
    }
    let sum = Sum::read(text).ok_or_else(not_a_number)?;
    let (low, high) = data_type.range().unwrap_or_default();
    let out_of_range = || ValueError::OutOfRange { text: text.into(), data_type, low, high };
    if sum.has_node_id {
        let offset = i64::try_from(sum.offset.value).map_err(|_| out_of_range())?;
        // Every node-ID must give a value of the type.
        if i128::from(offset) + 1 < low || i128::from(offset) + 127 > high {
            return Err(out_of_range());
        }
        return Ok((FileValue::NodeId { offset }, sum.offset.note));
    }
    let Literal { mut value, is_hexadecimal, mut note } = sum.offset;
    let bits = high - low;
    // A negative number with the digits of a longer type.
    let extended = [16, 32, 64].map(|width| value - (1 << width));
    if let Some(short) = extended.into_iter().find(|short| (low..0).contains(short))
        && is_hexadecimal
        && value > bits
    {
        (value, note) = (short, Some(ValueNote::TakenAsBits));
    }
    let note = if (low..=high).contains(&value) {
        note
    } else if is_hexadecimal && (0..=bits).contains(&value) {
        None
    } else if data_type != DataType::Boolean && (-(bits + 1) / 2..=bits).contains(&value) {
        Some(ValueNote::TakenAsBits)
    } else {
        return Err(out_of_range());
    };
    let value = data_type.integer(value).ok_or_else(not_a_number)?;
    Ok((FileValue::Fixed(value), note))
}

/// Reads a time as it is displayed: `3 d 04:05:06.789`.
fn time(text: &str) -> Option<DataValue> {
    let (days, clock) = text.split_once(" d ")?;
    let (clock, thousandths) = clock.split_once('.')?;
    let number = |digits: &str, length: usize, limit: u32| -> Option<u32> {
        let is_number =
            digits.len() == length && digits.bytes().all(|digit| digit.is_ascii_digit());
        is_number.then(|| digits.parse().ok()).flatten().filter(|number| *number < limit)
    };
    let mut parts = clock.splitn(3, ':');
    let mut part = |limit| number(parts.next()?, 2, limit);
    // 28 bits of milliseconds are 74 hours.
    let (hours, minutes, seconds) = (part(75)?, part(60)?, part(60)?);
    let thousandths = number(thousandths, 3, 1000)?;
    let milliseconds = ((hours * 60 + minutes) * 60 + seconds) * 1000 + thousandths;
    let is_time = milliseconds <= TIME_MASK;
    let days = days.parse().ok().filter(|_| is_time)?;
    Some(DataValue::Time { days, milliseconds })
}

fn boolean_word(text: &str) -> Option<bool> {
    if text.eq_ignore_ascii_case("true") {
        Some(true)
    } else if text.eq_ignore_ascii_case("false") {
        Some(false)
    } else {
        None
    }
}

/// A sum of numbers and at most one `$NODEID`.
struct Sum {
    has_node_id: bool,
    offset: Literal,
}

impl Sum {
    fn read(text: &str) -> Option<Self> {
        if let Some(offset) = literal(text) {
            return Some(Self { has_node_id: false, offset });
        }
        let mut has_node_id = false;
        let mut offset = Literal { value: 0, is_hexadecimal: false, note: None };
        for term in text.split('+').map(str::trim) {
            let name = term.strip_prefix('$').unwrap_or(term);
            if name.eq_ignore_ascii_case("NODEID") {
                if has_node_id {
                    return None;
                }
                has_node_id = true;
                if name == term {
                    offset.note = Some(ValueNote::TakenAsNodeId);
                }
                continue;
            }
            let number = literal(term)?;
            offset.value += number.value;
            offset.is_hexadecimal |= number.is_hexadecimal;
            offset.note = offset.note.or(number.note);
        }
        Some(Self { has_node_id, offset })
    }
}

/// Reads a real, written as a number or as its bits in hexadecimal.
fn real(data_type: DataType, text: &str) -> Result<DataValue, ValueError> {
    let not_a_number = || ValueError::NotANumber { text: text.into() };
    let bits = literal(text).filter(|literal| literal.is_hexadecimal && literal.value >= 0);
    if data_type == DataType::Real32 {
        let value = match bits {
            Some(bits) => u32::try_from(bits.value).ok().map(f32::from_bits),
            None => text.parse().ok(),
        };
        return value.map(DataValue::Real32).ok_or_else(not_a_number);
    }
    let value = match bits {
        Some(bits) => Some(f64::from_bits(bits.value as u64)),
        None => text.parse().ok(),
    };
    value.map(DataValue::Real64).ok_or_else(not_a_number)
}

/// Reads pairs of hexadecimal digits, with or without blanks and a leading `0x`.
fn bytes(text: &str) -> Result<Vec<u8>, ValueError> {
    let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")).unwrap_or(text);
    let digits = digits.chars().filter(|character| !character.is_whitespace());
    let digits: Option<Vec<_>> = digits.map(|character| character.to_digit(16)).collect();
    let not_bytes = || ValueError::NotBytes { text: text.into() };
    let digits = digits.filter(|digits| digits.len() % 2 == 0).ok_or_else(not_bytes)?;
    Ok(digits
        .chunks(2)
        .map(|pair| pair.iter().fold(0, |byte, digit| byte << 4 | *digit as u8))
        .collect())
}

/// Text of a value in a file; [`read`] returns the same value.
pub(super) fn write(data_type: DataType, value: &FileValue) -> String {
    let value = match value {
        FileValue::NodeId { offset } if *offset >= 0 => return format!("$NODEID+{offset:#X}"),
        FileValue::NodeId { offset } => return format!("$NODEID+{offset}"),
        FileValue::Fixed(value) => value,
    };
    match value {
        DataValue::Unsigned(number) => {
            let digits = 2 * data_type.size().unwrap_or(1);
            format!("0x{number:0digits$X}")
        }
        DataValue::Real32(real) if !real.is_finite() => format!("{:#010X}", real.to_bits()),
        DataValue::Real64(real) if !real.is_finite() => format!("{:#018X}", real.to_bits()),
        DataValue::Bytes(bytes) => bytes.iter().map(|byte| format!("{byte:02X}")).collect(),
        DataValue::Time { days, milliseconds } => {
            format!("{:#014X}", u64::from(*days) << 32 | u64::from(milliseconds & TIME_MASK))
        }
        value => format!("{value}"),
    }
}

impl DataType {
    /// Reads a value of this type from a text that a person wrote.
    ///
    /// Integers are decimal, hexadecimal (`0x`, also the bits of a negative number) or octal (a
    /// leading `0`); a BOOLEAN may also be `true` or `false`; reals are decimal or their bits in
    /// hexadecimal; OCTET_STRING, DOMAIN and types that CiA 301 does not define are pairs of
    /// hexadecimal digits; times have the form `3 d 04:05:06.789` or are their 48 bits as a number.
    ///
    /// # Errors
    /// [`ValueError`] with the text and what is allowed.
    pub fn parse(self, text: &str) -> Result<DataValue, ValueError> {
        let text = if self.class() == ValueClass::Text { text } else { text.trim() };
        match read_plain(self, text)? {
            (FileValue::Fixed(value), None | Some(ValueNote::TakenAsBoolean)) => Ok(value),
            (FileValue::Fixed(_), Some(ValueNote::TakenAsBits)) => {
                let (low, high) = self.range().unwrap_or_default();
                Err(ValueError::OutOfRange { text: text.into(), data_type: self, low, high })
            }
            _ => Err(ValueError::NotANumber { text: text.into() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reads(data_type: DataType, text: &str, value: DataValue, note: Option<ValueNote>) {
        assert_eq!(read(data_type, text), Ok((FileValue::Fixed(value), note)), "{text}");
    }

    #[test]
    fn numbers_are_decimal_hexadecimal_or_octal() {
        reads(DataType::Unsigned16, "100", DataValue::Unsigned(100), None);
        reads(DataType::Unsigned16, "0X1f", DataValue::Unsigned(31), None);
        reads(DataType::Unsigned16, "017", DataValue::Unsigned(15), None);
        reads(DataType::Integer8, "-5", DataValue::Signed(-5), None);
        reads(DataType::Integer8, "+5", DataValue::Signed(5), None);
        // digits may be the bits of a negative number
        reads(DataType::Integer8, "0xFF", DataValue::Signed(-1), None);
        reads(DataType::Unsigned64, "18446744073709551615", DataValue::Unsigned(u64::MAX), None);
        reads(DataType::Real32, "0x3F800000", DataValue::Real32(1.0), None);
        reads(DataType::Real64, "-1.5e3", DataValue::Real64(-1500.0), None);
        reads(DataType::OctetString, "0x01 AB", DataValue::Bytes([1, 0xAB].into()), None);
        let time = DataValue::Time { days: 1, milliseconds: 5 };
        reads(DataType::TimeOfDay, "0x000100000005", time, None);
    }

    #[test]
    fn unusual_numbers_are_read_with_a_note() {
        let bits = Some(ValueNote::TakenAsBits);
        reads(DataType::Unsigned32, "-1", DataValue::Unsigned(0xFFFF_FFFF), bits);
        reads(DataType::Integer16, "65535", DataValue::Signed(-1), bits);
        let decimal = Some(ValueNote::TakenAsDecimal);
        reads(DataType::Unsigned8, "09", DataValue::Unsigned(9), decimal);
        let comment = Some(ValueNote::CommentRemoved);
        reads(DataType::Unsigned8, "0x10 ; ten", DataValue::Unsigned(16), comment);
        let suffix = Some(ValueNote::SuffixRemoved);
        reads(DataType::Unsigned64, "0x00000010LL", DataValue::Unsigned(16), suffix);
        reads(DataType::VisibleString, "a ; b", DataValue::Text("a ; b".into()), None);
        assert!(read(DataType::OctetString, "0x").is_err());
        assert!(read(DataType::OctetString, "0x ; none").is_err());
        assert!(read(DataType::OctetString, "; none").is_err());
        for text in ["256", "five", "0x", "0xL", "u", "--1", "-+1", "", "1+", "$NODEID+$NODEID"] {
            assert!(read(DataType::Unsigned8, text).is_err(), "{text}");
        }
    }

    #[test]
    fn node_id_is_kept_as_an_expression() {
        let cases = [
            ("$NODEID+0x180", 0x180),
            ("0x180+$NODEID", 0x180),
            ("$NodeID + 0x80", 0x80),
            ("$NODEID", 0),
            ("$nodeid+0x80000000+0x180", 0x8000_0180),
        ];
        for (text, offset) in cases {
            let value = read(DataType::Unsigned32, text);
            assert_eq!(value, Ok((FileValue::NodeId { offset }, None)), "{text}");
        }
        let note = Some(ValueNote::TakenAsNodeId);
        let value = read(DataType::Unsigned32, "NODEID+1");
        assert_eq!(value, Ok((FileValue::NodeId { offset: 1 }, note)));
        // 127 + 129 does not fit into 8 bits
        assert!(read(DataType::Unsigned8, "$NODEID+128").is_ok());
        assert!(read(DataType::Unsigned8, "$NODEID+129").is_err());
    }

    #[test]
    fn text_of_a_person_is_read_strictly() {
        let time = DataValue::Time { days: 3, milliseconds: 14_706_789 };
        assert_eq!(DataType::TimeOfDay.parse("3 d 04:05:06.789"), Ok(time));
        for text in ["3 d 04:05", "3 d 04:65:06.789", "3 d 4:05:06.789", "x d 04:05:06.789"] {
            assert!(DataType::TimeOfDay.parse(text).is_err(), "{text}");
        }
        assert_eq!(DataType::Boolean.parse("true"), Ok(DataValue::Boolean(true)));
        assert_eq!(DataType::Integer16.parse(" -3 "), Ok(DataValue::Signed(-3)));
        assert!(DataType::Unsigned32.parse("-1").is_err());
        assert!(DataType::Unsigned32.parse("$NODEID+1").is_err());
        assert_eq!(
            alloc::format!("{}", DataType::Unsigned8.parse("x").unwrap_err()),
            "`x` is not a number; allowed: decimal, hexadecimal with 0x, octal with 0"
        );
    }
}
