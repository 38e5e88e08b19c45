//! From signal values to frames.

use std::collections::BTreeMap;

use ecan_protocol::can::CanFrame;
use thiserror::Error;

use super::signal::{Condition, Message, Number, Signal, SignalKind, UnknownName, similar_to};

const MAX_BYTES: usize = 64;

impl Message {
    /// Encodes a frame with these physical values or texts, by name of the signal. Numbers are decimal,
    /// or hexadecimal with `0x`; the nearest raw value is sent. Multiplexers that are not given get the
    /// value that the given signals need. All other signals have their start value, else the raw value
    /// 0; unused bits are 0.
    ///
    /// # Errors
    /// Unknown names, values out of range, and signals that cannot be in one frame.
    pub fn encode(&self, values: &[(&str, &str)]) -> Result<CanFrame, EncodeError> {
        let failure = |kind| EncodeError { message: self.name.clone(), kind: Box::new(kind) };
        self.frame_of(values).map_err(failure)
    }

    fn frame_of(&self, values: &[(&str, &str)]) -> Result<CanFrame, EncodeErrorKind> {
        // Raw values by index of the signal.
        let mut given = BTreeMap::new();
        for (name, value) in values {
            let index = self.index_of(name)?;
            let Some(signal) = self.signals.get(index) else { continue };
            if given.insert(index, signal.parse(value)?).is_some() {
                return Err(EncodeErrorKind::Twice((*name).to_owned()));
            }
        }
        self.set_multiplexers(&mut given)?;
        let raw = |signal: &Signal| {
            let index = self.signals.iter().position(|other| std::ptr::eq(other, signal))?;
            Some(given.get(&index).copied().unwrap_or(signal.initial))
        };
        let mut buffer = [0; MAX_BYTES];
        let data = buffer.get_mut(..self.length).unwrap_or_default();
        let mut written = Vec::new();
        for (index, signal) in self.signals.iter().enumerate() {
            if let Some(raw) = raw(signal).filter(|_| self.is_selected(index, &raw)) {
                // A signal that is not given does not overwrite one that is.
                match given.contains_key(&index) {
                    true => written.push((signal, raw)),
                    false => signal.layout.insert(data, raw),
                }
            }
        }
        written.iter().for_each(|(signal, raw)| signal.layout.insert(data, *raw));
        let overlap = written.iter().find(|(it, raw)| it.layout.extract(data) != Some(*raw));
        if let Some((signal, _)) = overlap {
            return Err(EncodeErrorKind::Overlap(signal.name.clone()));
        }
        let frame = match self.is_fd {
            true => CanFrame::fd(self.id, data, self.has_bit_rate_switch, false),
            false => CanFrame::classic(self.id, data),
        };
        frame.map_err(|_| EncodeErrorKind::Length(self.length))
    }

    /// Adds the raw values of the multiplexers that the given signals need.
    fn set_multiplexers(&self, given: &mut BTreeMap<usize, u64>) -> Result<(), EncodeErrorKind> {
        let mut open: Vec<usize> = given.keys().copied().collect();
        // Values that the signals so far allow for a multiplexer that is not given.
        while let Some(index) = open.pop() {
            let Some(signal) = self.signals.get(index) else { continue };
            let Some(condition) = &signal.condition else { continue };
            let at = condition.multiplexer;
            let Some(multiplexer) = self.signals.get(at) else { continue };
            let value = match given.get(&at) {
                Some(value) => *value,
                None => {
                    let value = self.common_value(at, condition, given);
                    given.insert(at, value);
                    open.push(at);
                    value
                }
            };
            if !condition.selects(value) {
                let ranges =
                    condition.values.iter().map(|range| match range.start() == range.end() {
                        true => range.start().to_string(),
                        false => format!("{} to {}", range.start(), range.end()),
                    });
                return Err(EncodeErrorKind::Multiplexer {
                    signal: signal.name.clone(),
                    multiplexer: multiplexer.name.clone(),
                    expected: ranges.collect::<Vec<_>>().join(" or "),
                    value,
                });
            }
        }
        Ok(())
    }

    /// The smallest value of a multiplexer that selects all given signals, else one that selects the
    /// signal of `condition`.
    fn common_value(&self, at: usize, condition: &Condition, given: &BTreeMap<usize, u64>) -> u64 {
        let of_given =
            given.keys().filter_map(|index| self.signals.get(*index)?.condition.as_ref());
        let conditions: Vec<_> = of_given.filter(|condition| condition.multiplexer == at).collect();
        // The smallest common value begins a range.
        let starts =
            conditions.iter().flat_map(|condition| &condition.values).map(|range| *range.start());
        let common = starts
            .filter(|start| conditions.iter().all(|condition| condition.selects(*start)))
            .min();
        let own = condition.values.first().map(|range| *range.start());
        common.or(own).unwrap_or_default()
    }
}

/// Number that a user gives.
#[derive(Clone, Copy)]
enum Given {
    Integer(i128),
    Real(f64),
}

impl Given {
    fn parse(text: &str) -> Option<Self> {
        let (sign, digits) = match text.strip_prefix('-') {
            Some(digits) => (-1, digits),
            None => (1, text),
        };
        if let Some(hex) = digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X")) {
            let is_hex = hex.bytes().all(|byte| byte.is_ascii_hexdigit());
            let value = u64::from_str_radix(hex, 16).ok().filter(|_| is_hex)?;
            return Some(Self::Integer(sign * i128::from(value)));
        }
        // Not "nan" or "inf", which may be texts of a signal.
        if !digits.starts_with(|character: char| character.is_ascii_digit() || character == '.') {
            return None;
        }
        // Larger ones are in no signal, and their differences would overflow.
        let is_small = |value: &i128| value.unsigned_abs() < 1 << 100;
        match text.parse::<i128>().ok().filter(is_small) {
            Some(value) => Some(Self::Integer(value)),
            None => text.parse().ok().map(Self::Real),
        }
    }

    fn as_f64(self) -> f64 {
        match self {
            Self::Integer(value) => value as f64,
            Self::Real(value) => value,
        }
    }
}

impl Signal {
    /// Raw value of a physical value or a text.
    fn parse(&self, text: &str) -> Result<u64, EncodeErrorKind> {
        if let Some(number) = Given::parse(text) {
            return self.raw_of_physical(number, text);
        }
        let exact = self.texts.iter().find(|(_, it)| it == text);
        let same = |pair: &&(i64, String)| pair.1.eq_ignore_ascii_case(text);
        if let Some((value, _)) = exact.or_else(|| self.texts.iter().find(same)) {
            let value = i128::from(*value);
            return self.checked(value).ok_or_else(|| self.out_of_range(text));
        }
        let texts = self.texts.iter().map(|(_, it)| it.as_str());
        let similar = similar_to(text, texts.clone());
        let listed = if similar.is_empty() { texts.map(str::to_owned).collect() } else { similar };
        let expected = match listed.as_slice() {
            [] => "a number".to_owned(),
            listed => format!("a number or a text, as in {}", listed.join(", ")),
        };
        let (signal, value) = (self.name.clone(), text.to_owned());
        Err(EncodeErrorKind::Value { signal, value, expected })
    }

    fn raw_of_physical(&self, number: Given, text: &str) -> Result<u64, EncodeErrorKind> {
        if self.factor == 0.0 {
            return Err(EncodeErrorKind::ZeroFactor(self.name.clone()));
        }
        let value = number.as_f64();
        if self.range.is_some_and(|(least, most)| !(least..=most).contains(&value)) {
            return Err(self.out_of_range(text));
        }
        let scaled = (value - self.offset) / self.factor;
        match self.kind {
            SignalKind::Float32 => Ok((scaled as f32).to_bits().into()),
            SignalKind::Float64 => Ok(scaled.to_bits()),
            SignalKind::Signed | SignalKind::Unsigned => {
                let raw = match (number, self.exact_scale()) {
                    (Given::Integer(value), Some((factor, offset))) => {
                        let distance = value - offset;
                        let half = factor.abs() / 2;
                        let away = if (distance < 0) == (factor < 0) { half } else { -half };
                        Some((distance + away * factor.signum()) / factor)
                    }
                    _ => scaled.is_finite().then(|| scaled.round() as i128),
                };
                raw.and_then(|raw| self.checked(raw)).ok_or_else(|| self.out_of_range(text))
            }
        }
    }

    /// Bits of an integer that fits.
    fn checked(&self, value: i128) -> Option<u64> {
        let (least, most) = self.integer_limits();
        let mask = u64::MAX >> (64 - self.layout.length());
        (least..=most).contains(&value).then_some(value as u64 & mask)
    }

    /// Bits of a raw start value; 0 if it does not fit.
    pub(crate) fn raw_of(&self, start: &str) -> u64 {
        let Some(number) = Given::parse(start) else { return 0 };
        match self.kind {
            SignalKind::Float32 => (number.as_f64() as f32).to_bits().into(),
            SignalKind::Float64 => number.as_f64().to_bits(),
            SignalKind::Signed | SignalKind::Unsigned => {
                self.checked(number.as_f64().round() as i128).unwrap_or(0)
            }
        }
    }

    fn out_of_range(&self, text: &str) -> EncodeErrorKind {
        let (least, most) = self.integer_limits();
        let bits =
            |value: i128| self.number(value as u64 & u64::MAX >> (64 - self.layout.length()));
        let (least, most) = match self.range {
            Some((least, most)) => (Number::Double(least), Number::Double(most)),
            None if self.factor < 0.0 => (bits(most), bits(least)),
            None => (bits(least), bits(most)),
        };
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        EncodeErrorKind::Range {
            signal: self.name.clone(),
            value: text.to_owned(),
            least: least.to_string(),
            most: most.to_string(),
            unit,
        }
    }
}

/// Signal values that give no frame.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("message {message}: {kind}")]
pub struct EncodeError {
    /// Name of the message.
    pub message: String,
    /// Kind of error.
    pub kind: Box<EncodeErrorKind>,
}

/// Kind of error of encoding.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum EncodeErrorKind {
    /// The message has no signal of this name.
    #[error(transparent)]
    Signal(#[from] UnknownName),
    /// A signal is given twice.
    #[error("signal {0} is given twice")]
    Twice(String),
    /// The value is neither a number nor one of the texts.
    #[error("{signal} = {value} is invalid; expected {expected}")]
    Value {
        /// Name of the signal.
        signal: String,
        /// The value.
        value: String,
        /// Allowed values.
        expected: String,
    },
    /// The value is outside the range of the file or of the bits.
    #[error("{signal} = {value} is out of range; allowed: {least} to {most}{unit}")]
    Range {
        /// Name of the signal.
        signal: String,
        /// The value.
        value: String,
        /// Smallest value.
        least: String,
        /// Largest value.
        most: String,
        /// Unit, after a blank; empty without one.
        unit: String,
    },
    /// All values of the signal are equal.
    #[error("{0} has the factor 0 and cannot be set")]
    ZeroFactor(String),
    /// The multiplexer has a value that excludes a given signal.
    #[error(
        "{signal} is in the frame if {multiplexer} is {expected}; given or needed otherwise: {value}"
    )]
    Multiplexer {
        /// Name of the signal.
        signal: String,
        /// Name of its multiplexer.
        multiplexer: String,
        /// Raw values that select the signal.
        expected: String,
        /// Raw value of the multiplexer.
        value: u64,
    },
    /// Another signal of the frame has the same bits.
    #[error("{0} shares bits with another signal of the frame")]
    Overlap(String),
    /// Length that no frame has.
    #[error(
        "{0} bytes are no length of a CAN FD frame; allowed: 0 to 8, 12, 16, 20, 24, 32, 48, 64"
    )]
    Length(usize),
}
