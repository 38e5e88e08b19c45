//! Messages of a file.

use super::codec::BitLayout;
use super::codec::Decoded;
use super::reader;
use super::reader::DbcFaults;
use core::fmt;
use core::ops::RangeInclusive;
use ecan_protocol::can::{CanFrame, CanId};
use std::collections::HashMap;
use thiserror::Error;

/// Messages of a DBC file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Database {
    messages: Vec<Message>,
    by_id: HashMap<(bool, u32), usize>,
}

impl Database {
    /// Parses a file in UTF-8 or Windows-1252.
    ///
    /// # Errors
    /// A syntax error, or all other faults.
    pub fn parse(bytes: &[u8]) -> Result<Self, DbcFaults> {
        let messages = reader::read(bytes)?;
        let by_id = messages.iter().enumerate().map(|(at, it)| (key(it.id), at)).collect();
        Ok(Self { messages, by_id })
    }

    /// Messages in the order of the file.
    #[must_use]
    pub fn messages(&self) -> &[Message] {
        &self.messages
    }

    /// Message of a CAN ID.
    #[must_use]
    pub fn message(&self, id: CanId) -> Option<&Message> {
        self.messages.get(*self.by_id.get(&key(id))?)
    }

    /// Message of a name.
    ///
    /// # Errors
    /// No message has this name.
    pub fn message_named(&self, name: &str) -> Result<&Message, UnknownName> {
        let names = self.messages.iter().map(|it| it.name.as_str());
        let at = find("message", name, names)?;
        let unknown =
            || UnknownName { what: "message", name: name.to_owned(), similar: Vec::new() };
        self.messages.get(at).ok_or_else(unknown)
    }

    /// Decodes a frame; `None` if no message has its CAN ID.
    #[must_use]
    pub fn decode(&self, frame: &CanFrame) -> Option<Decoded<'_>> {
        self.message(frame.id()).map(|message| message.decode(frame))
    }
}

fn key(id: CanId) -> (bool, u32) {
    (id.is_extended(), id.raw())
}

/// Message of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// CAN ID.
    pub id: CanId,
    /// Name, unique in its file.
    pub name: String,
    /// Number of data bytes.
    pub length: usize,
    /// CAN FD: more than 8 bytes, or the attribute `VFrameFormat` names CAN FD.
    pub is_fd: bool,
    /// Bit rate switch of a CAN FD frame: the attribute `CANFD_BRS`, else on.
    pub has_bit_rate_switch: bool,
    /// Line of the file, from 1.
    pub line: usize,
    /// Signals in the order of the file.
    pub signals: Vec<Signal>,
}

impl Message {
    /// Index of a signal.
    ///
    /// # Errors
    /// No signal has this name.
    pub fn index_of(&self, name: &str) -> Result<usize, UnknownName> {
        find("signal", name, self.signals.iter().map(|it| it.name.as_str()))
    }

    /// Returns whether a signal is in a frame, by the raw values of its multiplexers.
    pub(crate) fn is_selected(&self, index: usize, raw: &impl Fn(&Signal) -> Option<u64>) -> bool {
        let Some(signal) = self.signals.get(index) else { return false };
        let Some(condition) = &signal.condition else { return true };
        // The reader rejects a multiplexer that depends on itself.
        let multiplexer = self.signals.get(condition.multiplexer);
        let is_selecting = multiplexer.and_then(raw).is_some_and(|it| condition.selects(it));
        is_selecting && self.is_selected(condition.multiplexer, raw)
    }
}

/// Most decimals of a factor or offset that the values of a signal are written with.
const MAX_DECIMALS: usize = 12;
/// Largest whole number that a double represents exactly.
const MAX_EXACT: f64 = 9_007_199_254_740_992.0;

/// Raw value of a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignalKind {
    /// Unsigned integer.
    Unsigned,
    /// Signed integer in two's complement.
    Signed,
    /// IEEE 754 number of 32 bits.
    Float32,
    /// IEEE 754 number of 64 bits.
    Float64,
}

/// Multiplexing of a signal: it is in a frame if the multiplexer has one of these raw values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Condition {
    /// Index of the multiplexer among the signals of the message.
    pub multiplexer: usize,
    /// Raw values of the multiplexer.
    pub values: Vec<RangeInclusive<u64>>,
}

impl Condition {
    /// Returns whether the multiplexer's raw value selects the signal.
    #[must_use]
    pub fn selects(&self, value: u64) -> bool {
        self.values.iter().any(|range| range.contains(&value))
    }
}

/// Signal of a message.
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// Name, unique in its message.
    pub name: String,
    /// Unit; empty without one.
    pub unit: String,
    /// Kind of the raw value.
    pub kind: SignalKind,
    /// Physical value of a raw value of 1, without the offset.
    pub factor: f64,
    /// Physical value of a raw value of 0.
    pub offset: f64,
    /// Smallest and largest physical value; `None` if the file gives no range.
    pub range: Option<(f64, f64)>,
    /// Texts of raw values, in the order of the file.
    pub texts: Vec<(i64, String)>,
    /// Multiplexing; `None` if the signal is in each frame.
    pub condition: Option<Condition>,
    /// Raw value of a frame in which the signal is not given (`GenSigStartValue`), else 0.
    pub(crate) initial: u64,
    pub(crate) layout: BitLayout,
}

impl Signal {
    /// Raw value as an integer; `None` for floats.
    pub(crate) fn integer(&self, raw: u64) -> Option<i128> {
        match self.kind {
            SignalKind::Unsigned => Some(raw.into()),
            SignalKind::Signed => {
                let unused = 64 - self.layout.length();
                Some(i128::from((raw << unused) as i64 >> unused))
            }
            SignalKind::Float32 | SignalKind::Float64 => None,
        }
    }

    /// Physical value of a raw value.
    pub(crate) fn number(&self, raw: u64) -> Number {
        let Self { factor, offset, .. } = *self;
        match (self.integer(raw), self.kind) {
            (Some(integer), _) => match self.exact_scale() {
                Some((factor, offset)) => Number::Integer(integer * factor + offset),
                None => {
                    let value = integer as f64 * factor + offset;
                    match decimals(factor).max(decimals(offset)) {
                        decimals @ 0..=MAX_DECIMALS => Number::Decimal(value, decimals),
                        _ => Number::Double(value),
                    }
                }
            },
            (None, SignalKind::Float32) => {
                let value = f32::from_bits(raw as u32);
                match (factor, offset) {
                    (1.0, 0.0) => Number::Single(value),
                    _ => Number::Single((f64::from(value) * factor + offset) as f32),
                }
            }
            (None, _) => Number::Double(f64::from_bits(raw) * factor + offset),
        }
    }

    /// Factor and offset, if both are whole numbers.
    pub(crate) fn exact_scale(&self) -> Option<(i128, i128)> {
        let is_whole = |value: f64| value.fract() == 0.0 && value.abs() <= MAX_EXACT;
        (is_whole(self.factor) && is_whole(self.offset))
            .then_some((self.factor as i128, self.offset as i128))
    }

    /// Text of a raw value.
    pub(crate) fn text(&self, raw: u64) -> Option<&str> {
        let integer = self.integer(raw)?;
        let text = self.texts.iter().find(|(value, _)| i128::from(*value) == integer);
        text.map(|(_, text)| text.as_str())
    }

    /// Smallest and largest raw value of an integer signal.
    pub(crate) fn integer_limits(&self) -> (i128, i128) {
        let length = self.layout.length();
        match self.kind {
            SignalKind::Signed => (-(1_i128 << (length - 1)), (1_i128 << (length - 1)) - 1),
            _ => (0, (1_i128 << length) - 1),
        }
    }
}

/// Number of decimals of a number.
fn decimals(value: f64) -> usize {
    value.to_string().split_once('.').map_or(0, |(_, digits)| digits.len())
}

/// Powers of ten from and to which a real number without decimals of its own is written in digits.
const LARGE: f64 = 1e15;
const SMALL: f64 = 1e-5;

/// Physical value of a signal. `Display` writes it with its decimals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Number {
    /// Whole number, exact.
    Integer(i128),
    /// Integer signal with a fraction in its factor or offset: value and number of decimals.
    Decimal(f64, usize),
    /// Real number with the precision of a float.
    Single(f32),
    /// Real number with the precision of a double.
    Double(f64),
}

impl Number {
    /// Value as a double.
    #[must_use]
    pub fn as_f64(self) -> f64 {
        match self {
            Self::Integer(value) => value as f64,
            Self::Decimal(value, _) | Self::Double(value) => value,
            Self::Single(value) => value.into(),
        }
    }
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_usual = |value: f64| {
            value == 0.0 || !value.is_finite() || (SMALL..LARGE).contains(&value.abs())
        };
        match *self {
            Self::Integer(value) => write!(f, "{value}"),
            Self::Decimal(value, decimals) if value.abs() < LARGE => {
                write!(f, "{value:.decimals$}")
            }
            Self::Single(value) if is_usual(value.into()) => write!(f, "{value}"),
            Self::Double(value) if is_usual(value) => write!(f, "{value}"),
            Self::Single(value) => write!(f, "{value:e}"),
            Self::Decimal(value, _) | Self::Double(value) => write!(f, "{value:e}"),
        }
    }
}

/// Least similarity of a listed name (Jaro-Winkler), and most names.
const LEAST_SIMILARITY: f64 = 0.8;
const MOST_NAMES: usize = 5;

/// A name that does not exist.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("unknown {what} \"{name}\"{}", list(.similar))]
pub struct UnknownName {
    /// Kind of the name.
    pub what: &'static str,
    /// The name.
    pub name: String,
    /// Existing names that are similar, the most similar first.
    pub similar: Vec<String>,
}

fn list(similar: &[String]) -> String {
    match similar {
        [] => String::new(),
        names => format!("; similar: {}", names.join(", ")),
    }
}

/// Index of a name.
pub fn find<'a>(
    what: &'static str,
    name: &str,
    names: impl Iterator<Item = &'a str> + Clone,
) -> Result<usize, UnknownName> {
    names.clone().position(|it| it == name).ok_or_else(|| UnknownName {
        what,
        name: name.to_owned(),
        similar: similar_to(name, names),
    })
}

/// Names that are similar, the most similar first; upper and lower case do not count.
pub fn similar_to<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Vec<String> {
    let wanted = name.to_lowercase();
    let similarity = |it: &str| {
        let it = it.to_lowercase();
        match it.contains(&wanted) && wanted.len() >= 3 {
            true => 1.0,
            false => strsim::jaro_winkler(&it, &wanted),
        }
    };
    let mut rated: Vec<_> = names.map(|it| (similarity(it), it)).collect();
    rated.retain(|(similarity, _)| *similarity >= LEAST_SIMILARITY);
    rated.sort_by(|a, b| b.0.total_cmp(&a.0));
    rated.into_iter().take(MOST_NAMES).map(|(_, it)| it.to_owned()).collect()
}
