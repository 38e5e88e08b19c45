//! A signal.

use core::ops::RangeInclusive;

use crate::dbc::bit_layout::BitLayout;
use crate::dbc::number::Number;

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
