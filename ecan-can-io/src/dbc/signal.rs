//! Messages and signals of a database, their bit layout, numbers and names.

use core::fmt;
use core::ops::RangeInclusive;

use ecan_protocol::can::CanId;
use thiserror::Error;

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
    /// Name, unique in its message; the long one, if the file has it (`SystemSignalLongSymbol`).
    pub name: String,
    /// Name in the statements, if it is another one.
    pub short_name: Option<String>,
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

/// Message of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// CAN ID.
    pub id: CanId,
    /// Name; the long one, if the file has it (`SystemMessageLongSymbol`).
    pub name: String,
    /// Name in the statements, if it is another one.
    pub short_name: Option<String>,
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
        let is_short = |signal: &Signal| signal.short_name.as_deref() == Some(name);
        match self.signals.iter().position(is_short) {
            Some(at) => Ok(at),
            None => find("signal", name, self.signals.iter().map(|signal| signal.name.as_str())),
        }
    }

    /// Returns whether a signal is in a frame, by the raw values of its multiplexers.
    pub(crate) fn is_selected(&self, index: usize, raw: &impl Fn(&Signal) -> Option<u64>) -> bool {
        let Some(signal) = self.signals.get(index) else { return false };
        let Some(condition) = &signal.condition else { return true };
        // The reader rejects a multiplexer that depends on itself.
        let multiplexer = self.signals.get(condition.multiplexer);
        let is_selecting = multiplexer.and_then(raw).is_some_and(|value| condition.selects(value));
        is_selecting && self.is_selected(condition.multiplexer, raw)
    }
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
    names.clone().position(|known| known == name).ok_or_else(|| UnknownName {
        what,
        name: name.to_owned(),
        similar: similar_to(name, names),
    })
}

/// Names that are similar, the most similar first; upper and lower case do not count.
pub fn similar_to<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Vec<String> {
    let wanted = name.to_lowercase();
    let similarity = |text: &str| {
        let text = text.to_lowercase();
        match text.contains(&wanted) && wanted.len() >= 3 {
            true => 1.0,
            false => strsim::jaro_winkler(&text, &wanted),
        }
    };
    let mut rated: Vec<_> = names.map(|name| (similarity(name), name)).collect();
    rated.retain(|(similarity, _)| *similarity >= LEAST_SIMILARITY);
    rated.sort_by(|a, b| b.0.total_cmp(&a.0));
    rated.into_iter().take(MOST_NAMES).map(|(_, it)| it.to_owned()).collect()
}

/// Order of the bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ByteOrder {
    /// Intel: the start bit is the least significant one.
    LittleEndian,
    /// Motorola: the start bit is the most significant one.
    BigEndian,
}

/// Bits of a signal. Bit 0 is the least significant bit of byte 0, bit 8 that of byte 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitLayout {
    start: u32,
    length: u32,
    order: ByteOrder,
}

impl BitLayout {
    /// Longest signal in bits.
    pub const MAX_LENGTH: u32 = 64;

    /// Layout of 1 to 64 bits that lie within a message of `bytes` bytes.
    pub fn new(start: u64, length: u64, order: ByteOrder, bytes: usize) -> Option<Self> {
        let (start, length) = (u32::try_from(start).ok()?, u32::try_from(length).ok()?);
        let layout = Self { start, length, order };
        let is_valid = (1..=Self::MAX_LENGTH).contains(&length) && layout.bytes()? <= bytes;
        is_valid.then_some(layout)
    }

    /// Number of data bytes that the signal needs.
    fn bytes(self) -> Option<usize> {
        let last = match self.order {
            ByteOrder::LittleEndian => self.start.checked_add(self.length - 1)?,
            ByteOrder::BigEndian => self.linear_start().checked_add(self.length - 1)?,
        };
        Some(last as usize / 8 + 1)
    }

    pub const fn length(self) -> u32 {
        self.length
    }

    /// Index of the most significant bit, counted from the most significant bit of byte 0.
    const fn linear_start(self) -> u32 {
        self.start / 8 * 8 + (7 - self.start % 8)
    }

    /// Byte and bit of each bit of the signal, least significant first.
    fn bits(self) -> impl Iterator<Item = (usize, u32)> {
        (0..self.length).map(move |at| match self.order {
            ByteOrder::LittleEndian => ((self.start + at) as usize / 8, (self.start + at) % 8),
            ByteOrder::BigEndian => {
                let linear = self.linear_start() + self.length - 1 - at;
                (linear as usize / 8, 7 - linear % 8)
            }
        })
    }

    /// Returns the bits, or `None` if the data are too short.
    pub fn extract(self, data: &[u8]) -> Option<u64> {
        let mut raw = 0;
        for (at, (byte, bit)) in (0..).zip(self.bits()) {
            raw |= u64::from(data.get(byte)? >> bit & 1) << at;
        }
        Some(raw)
    }

    /// Writes the bits. Data that are too short lose bits.
    pub fn insert(self, data: &mut [u8], raw: u64) {
        for (at, (byte, bit)) in (0..).zip(self.bits()) {
            if let Some(byte) = data.get_mut(byte) {
                *byte = *byte & !(1 << bit) | u8::from(raw >> at & 1 == 1) << bit;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn layouts_match_the_examples_of_the_format() {
        let little = BitLayout::new(4, 12, ByteOrder::LittleEndian, 2).unwrap();
        assert_eq!(little.extract(&[0xA0, 0xBC]), Some(0xBCA));
        // From bit 3 of byte 0 down, then from bit 7 of byte 1.
        let big = BitLayout::new(3, 12, ByteOrder::BigEndian, 2).unwrap();
        assert_eq!(big.extract(&[0xFA, 0xBC]), Some(0xABC));
        assert_eq!(big.extract(&[0xFA]), None);
        let mut data = [0xFF, 0];
        big.insert(&mut data, 0x123);
        assert_eq!(data, [0xF1, 0x23]);
    }

    #[test]
    fn layout_outside_the_message_is_rejected() {
        use ByteOrder::{BigEndian, LittleEndian};
        assert!(BitLayout::new(0, 64, LittleEndian, 8).is_some());
        assert!(BitLayout::new(7, 64, BigEndian, 8).is_some());
        assert!(BitLayout::new(1, 64, LittleEndian, 8).is_none());
        assert!(BitLayout::new(6, 64, BigEndian, 8).is_none());
        assert!(BitLayout::new(0, 0, LittleEndian, 8).is_none());
        assert!(BitLayout::new(0, 65, LittleEndian, 64).is_none());
        assert!(BitLayout::new(u64::MAX, 1, BigEndian, 8).is_none());
        assert!(BitLayout::new(u32::MAX.into(), 8, LittleEndian, 8).is_none());
        assert!(BitLayout::new(u32::MAX.into(), 64, BigEndian, 8).is_none());
    }

    proptest! {
        #[test]
        fn inserted_bits_are_extracted_and_others_stay(
            start in 0..512_u64,
            length in 1..=64_u64,
            is_big: bool,
            raw: u64,
            fill: u8,
        ) {
            let order = if is_big { ByteOrder::BigEndian } else { ByteOrder::LittleEndian };
            let Some(layout) = BitLayout::new(start, length, order, 64) else { return Ok(()) };
            let mut data = [fill; 64];
            layout.insert(&mut data, raw);
            let mask = u64::MAX >> (64 - length);
            prop_assert_eq!(layout.extract(&data), Some(raw & mask));
            let before = layout.extract(&[fill; 64]).unwrap();
            layout.insert(&mut data, before);
            prop_assert_eq!(data, [fill; 64]);
        }
    }
}
