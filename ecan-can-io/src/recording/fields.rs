//! Fields of a line, separated by blanks.

use std::str::SplitAsciiWhitespace;

use ecan_protocol::can::{CanFrame, CanId, Dlc};

use super::RecordingErrorKind;

/// Characters of a field in a message.
const MAX_QUOTED: usize = 80;

pub type FieldResult<T> = Result<T, RecordingErrorKind>;

/// Reads the fields of a line in their order.
#[derive(Clone, Debug)]
pub struct Fields<'a>(SplitAsciiWhitespace<'a>);

impl<'a> Fields<'a> {
    pub fn new(line: &'a str) -> Self {
        Self(line.split_ascii_whitespace())
    }

    pub fn next(&mut self) -> Option<&'a str> {
        self.0.next()
    }

    pub fn peek(&self) -> Option<&'a str> {
        self.0.clone().next()
    }

    /// Takes a field that must exist.
    pub fn take(&mut self, field: &'static str, expected: &'static str) -> FieldResult<&'a str> {
        self.next().ok_or(RecordingErrorKind::Missing { field, expected })
    }

    /// Takes a field that must have an allowed value.
    pub fn parse<T>(
        &mut self,
        field: &'static str,
        expected: &'static str,
        parse: impl FnOnce(&str) -> Option<T>,
    ) -> FieldResult<T> {
        let text = self.take(field, expected)?;
        parse(text).ok_or_else(|| invalid(field, text, expected))
    }

    /// Takes data bytes.
    pub fn data<'b>(&mut self, buffer: &'b mut [u8], radix: u32) -> FieldResult<&'b [u8]> {
        let expected = if radix == 16 { "a byte in hexadecimal" } else { "a byte in decimal" };
        for byte in &mut *buffer {
            *byte = self.parse("data byte", expected, |text| byte_of(text, radix))?;
        }
        Ok(buffer)
    }
}

pub fn invalid(field: &'static str, text: &str, expected: &'static str) -> RecordingErrorKind {
    // No control sequence of the file reaches a terminal.
    let printable = |it: char| if it.is_control() { char::REPLACEMENT_CHARACTER } else { it };
    let text = text.chars().take(MAX_QUOTED).map(printable).collect();
    RecordingErrorKind::Invalid { field, text, expected }
}

fn byte_of(text: &str, radix: u32) -> Option<u8> {
    number(text, radix).and_then(|value| u8::try_from(value).ok())
}

/// Parses an unsigned number without sign.
pub fn number(text: &str, radix: u32) -> Option<u32> {
    let is_number = text.chars().all(|it| it.is_digit(radix));
    u32::from_str_radix(text, radix).ok().filter(|_| is_number)
}

/// Parses a decimal fraction in nanoseconds, with at most nine decimals of a unit of
/// `10^digits` nanoseconds.
pub fn time_ns(text: &str, digits: u32) -> Option<u64> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let is_number = |text: &str| text.bytes().all(|it| it.is_ascii_digit());
    if !is_number(whole) || !is_number(fraction) {
        return None;
    }
    let unit = 10_u64.checked_pow(digits)?;
    let whole = whole.parse::<u64>().ok()?.checked_mul(unit)?;
    // Digits below a nanosecond are dropped.
    let fraction = fraction.get(..fraction.len().min(digits as usize)).unwrap_or_default();
    let missing = digits.checked_sub(u32::try_from(fraction.len()).ok()?)?;
    let part = if fraction.is_empty() { 0 } else { fraction.parse::<u64>().ok()? };
    whole.checked_add(part.checked_mul(10_u64.checked_pow(missing)?)?)
}

/// A classic data frame, of which a DLC above 8 has 8 bytes.
pub fn classic(fields: &mut Fields<'_>, id: CanId, dlc: Dlc, radix: u32) -> FieldResult<CanFrame> {
    let mut buffer = [0; 8];
    let data = fields.data(buffer.get_mut(..dlc.classic_len()).unwrap_or_default(), radix)?;
    CanFrame::classic(id, data)
        .map_err(|_| RecordingErrorKind::LengthMismatch { length: data.len(), dlc: dlc.value() })
}

/// A remote frame; a DLC above 8 counts as 8.
pub fn remote(id: CanId, dlc: u8) -> FieldResult<CanFrame> {
    let invalid = || RecordingErrorKind::LengthMismatch { length: 0, dlc };
    let dlc = Dlc::new(dlc.min(8)).ok_or_else(invalid)?;
    CanFrame::remote(id, dlc).map_err(|_| invalid())
}

/// Name of the interface of a channel that counts from 1.
pub fn interface(text: &str) -> Option<String> {
    let channel = number(text, 10)?.checked_sub(1)?;
    Some(format!("can{channel}"))
}
