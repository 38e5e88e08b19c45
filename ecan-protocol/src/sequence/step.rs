//! Steps of a configuration: actions, values, conditions, and the failure of a step.

use core::fmt;
use core::time::Duration;

use thiserror::Error;

use crate::object::{AbortCode, SdoWrite};

/// No device-specific action exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoAction {}

impl fmt::Display for NoAction {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

/// Failures that do not end the sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tolerance {
    /// None: the step must succeed.
    #[default]
    None,
    /// The object or subindex does not exist.
    Missing,
    /// The object cannot be written.
    ReadOnly,
    /// Any abort by the device, or a value other than the expected one.
    Any,
}

impl Tolerance {
    pub(super) fn covers(self, code: AbortCode) -> bool {
        match self {
            Self::None => false,
            Self::Missing => matches!(code, AbortCode::NO_OBJECT | AbortCode::NO_SUBINDEX),
            Self::ReadOnly => matches!(code, AbortCode::READ_ONLY | AbortCode::UNSUPPORTED_ACCESS),
            Self::Any => true,
        }
    }
}

/// Action of a step; `A` is the device-specific one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action<A = NoAction> {
    /// Downloads a value.
    Write {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// The value, with as many bytes as the object has.
        value: SdoValue,
    },
    /// Uploads a 32-bit value, changes some bits and downloads the result.
    Modify {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Bits that become 0.
        clear: u32,
        /// Bits that become 1.
        set: u32,
    },
    /// Uploads a value and reports it to the caller of [`Sequence::advance`](super::Sequence::advance).
    Read {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
    },
    /// Uploads a value, which must meet a condition.
    Expect {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Condition.
        expected: Expectation,
    },
    /// Uploads a value repeatedly until it meets a condition.
    Await {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Condition.
        expected: Expectation,
        /// Longest waiting time.
        timeout: Duration,
    },
    /// Waits for this time.
    Pause(Duration),
    /// Device-specific action.
    Device(A),
}

impl<A> Action<A> {
    /// Index of the object; `None` for an action without one.
    pub fn index(&self) -> Option<u16> {
        match *self {
            Self::Write { index, .. }
            | Self::Modify { index, .. }
            | Self::Read { index, .. }
            | Self::Expect { index, .. }
            | Self::Await { index, .. } => Some(index),
            Self::Pause(_) | Self::Device(_) => None,
        }
    }
}

impl<A: fmt::Display> fmt::Display for Action<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Write { index, subindex, value } => {
                write!(f, "write 0x{index:04X}:{subindex:02X} = {value}")
            }
            Self::Modify { index, subindex, .. } => {
                write!(f, "change 0x{index:04X}:{subindex:02X}")
            }
            Self::Read { index, subindex } => write!(f, "read 0x{index:04X}:{subindex:02X}"),
            Self::Expect { index, subindex, .. } => write!(f, "check 0x{index:04X}:{subindex:02X}"),
            Self::Await { index, subindex, .. } => {
                write!(f, "wait for 0x{index:04X}:{subindex:02X}")
            }
            Self::Pause(time) => write!(f, "wait {} ms", time.as_millis()),
            Self::Device(action) => action.fmt(f),
        }
    }
}

/// One step of a configuration: plain data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step<A = NoAction> {
    /// Action.
    pub action: Action<A>,
    /// Purpose in a few words, for messages; may be empty.
    pub purpose: &'static str,
    /// Failures that do not end the sequence.
    pub tolerance: Tolerance,
}

impl<A> From<Action<A>> for Step<A> {
    fn from(action: Action<A>) -> Self {
        Self { action, purpose: "", tolerance: Tolerance::None }
    }
}

impl<A> From<SdoWrite> for Step<A> {
    fn from(write: SdoWrite) -> Self {
        Self::write(write.index, write.subindex, write)
    }
}

/// Filler of an empty list: a pause of no length.
impl<A> Default for Step<A> {
    fn default() -> Self {
        Self::pause(Duration::ZERO)
    }
}

impl<A> Step<A> {
    /// Downloads a value.
    pub fn write(index: u16, subindex: u8, value: impl Into<SdoValue>) -> Self {
        Action::Write { index, subindex, value: value.into() }.into()
    }

    /// Uploads a 32-bit value, clears and sets bits, and downloads the result.
    pub fn modify(index: u16, subindex: u8, clear: u32, set: u32) -> Self {
        Action::Modify { index, subindex, clear, set }.into()
    }

    /// Uploads a value and reports it.
    pub fn read(index: u16, subindex: u8) -> Self {
        Action::Read { index, subindex }.into()
    }

    /// Uploads a value, which must be this one.
    pub fn expect(index: u16, subindex: u8, value: impl Into<SdoValue>) -> Self {
        Self::expect_that(index, subindex, Expectation::Equals(value.into().raw()))
    }

    /// Uploads a value, which must meet a condition.
    pub fn expect_that(index: u16, subindex: u8, expected: Expectation) -> Self {
        Action::Expect { index, subindex, expected }.into()
    }

    /// Uploads a value repeatedly until it is this one.
    pub fn await_value(
        index: u16,
        subindex: u8,
        value: impl Into<SdoValue>,
        timeout: Duration,
    ) -> Self {
        let expected = Expectation::Equals(value.into().raw());
        Action::Await { index, subindex, expected, timeout }.into()
    }

    /// Waits for this time.
    pub fn pause(time: Duration) -> Self {
        Action::Pause(time).into()
    }

    /// Executes a device-specific action.
    pub fn device(action: A) -> Self {
        Action::Device(action).into()
    }

    /// Sets the purpose, for messages.
    #[must_use]
    pub fn named(mut self, purpose: &'static str) -> Self {
        self.purpose = purpose;
        self
    }

    /// Tolerates a device that does not have the object.
    #[must_use]
    pub fn if_present(mut self) -> Self {
        self.tolerance = Tolerance::Missing;
        self
    }

    /// Tolerates a device whose object cannot be written; a later readback decides.
    #[must_use]
    pub fn if_writable(mut self) -> Self {
        self.tolerance = Tolerance::ReadOnly;
        self
    }

    /// Tolerates any abort by the device, and any value.
    #[must_use]
    pub fn if_accepted(mut self) -> Self {
        self.tolerance = Tolerance::Any;
        self
    }
}

/// `mapping off (write 0x1600:00 = 0x00)`
impl<A: fmt::Display> fmt::Display for Step<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.purpose.is_empty() {
            self.action.fmt(f)
        } else {
            write!(f, "{} ({})", self.purpose, self.action)
        }
    }
}

/// A value of up to eight bytes as SDO carries it, little-endian. Created from the integer type
/// that the object has: `Step::write(0x6060, 0, 8i8)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct SdoValue {
    bytes: [u8; 8],
    length: u8,
}

impl SdoValue {
    /// Takes the first eight of these little-endian bytes.
    pub fn from_bytes(source: &[u8]) -> Self {
        let mut bytes = [0; 8];
        for (to, from) in bytes.iter_mut().zip(source) {
            *to = *from;
        }
        Self { bytes, length: source.len().min(8) as u8 }
    }

    /// Bytes to send.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or_default()
    }

    /// Value without sign; missing bytes count as 0.
    pub fn raw(&self) -> u64 {
        u64::from_le_bytes(self.bytes)
    }
}

/// Hexadecimal, with as many digits as the value has bytes: `0x000F`.
impl fmt::Display for SdoValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = 2 + self.as_bytes().len() * 2;
        write!(f, "{:#0width$X}", self.raw())
    }
}

impl From<SdoWrite> for SdoValue {
    fn from(write: SdoWrite) -> Self {
        let (bytes, length) = write.bytes();
        Self::from_bytes(bytes.get(..length).unwrap_or_default())
    }
}

macro_rules! from_integer {
    ($($integer:ty),*) => {$(
        impl From<$integer> for SdoValue {
            fn from(value: $integer) -> Self {
                Self::from_bytes(&value.to_le_bytes())
            }
        }
    )*};
}

from_integer!(u8, u16, u32, u64, i8, i16, i32, i64);

/// Condition on the value of an object, read without sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Expectation {
    /// Exactly this value.
    Equals(u64),
    /// This value in the bits of the mask; other bits are ignored.
    Masked {
        /// Expected bits.
        value: u64,
        /// Bits that are compared.
        mask: u64,
    },
    /// At least this value.
    AtLeast(u64),
    /// At most this value.
    AtMost(u64),
    /// All of these bits; other bits are ignored.
    HasBits(u64),
    /// At least one of these bits.
    HasAny(u64),
    /// One of these values. Not serializable.
    #[cfg_attr(feature = "serde", serde(skip))]
    OneOf(&'static [u64]),
}

impl Expectation {
    /// Returns whether `value` meets the condition.
    pub fn is_met_by(self, value: u64) -> bool {
        match self {
            Self::Equals(expected) => value == expected,
            Self::Masked { value: expected, mask } => (value ^ expected) & mask == 0,
            Self::AtLeast(least) => value >= least,
            Self::AtMost(most) => value <= most,
            Self::HasBits(bits) => value & bits == bits,
            Self::HasAny(bits) => value & bits != 0,
            Self::OneOf(values) => values.contains(&value),
        }
    }
}

/// Numbers are decimal, bits and masks hexadecimal; with `{:#}` all are hexadecimal.
impl fmt::Display for Expectation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = |f: &mut fmt::Formatter<'_>, prefix: &str, number: u64| {
            f.write_str(prefix)?;
            if f.alternate() { write!(f, "0x{number:X}") } else { write!(f, "{number}") }
        };
        match *self {
            Self::Equals(expected) => number(f, "", expected),
            Self::Masked { value, mask } => write!(f, "0x{value:X} in the bits 0x{mask:X}"),
            Self::AtLeast(least) => number(f, "at least ", least),
            Self::AtMost(most) => number(f, "at most ", most),
            Self::HasBits(bits) => write!(f, "the bits 0x{bits:X}"),
            Self::HasAny(bits) => write!(f, "one of the bits 0x{bits:X}"),
            Self::OneOf(values) => write!(f, "one of {values:?}"),
        }
    }
}

/// Failure of one step; `E` is the error of the [`ObjectAccess`](super::ObjectAccess).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum StepError<E> {
    /// The transfer or the action failed.
    #[error(transparent)]
    Access(#[from] E),
    /// The object has another value.
    #[error("value is 0x{found:X}, expected {expected:#}")]
    Mismatch {
        /// Value of the object.
        found: u64,
        /// Expected value.
        expected: Expectation,
    },
    /// The object did not reach the value in time.
    #[error("value is 0x{found:X} after {}, expected {expected:#}", Milliseconds(*waited))]
    TimedOut {
        /// Last value of the object.
        found: u64,
        /// Expected value.
        expected: Expectation,
        /// Waiting time.
        waited: Duration,
    },
}

struct Milliseconds(Duration);

impl fmt::Display for Milliseconds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ms", self.0.as_millis())
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString as _;

    use super::*;

    extern crate std;

    #[test]
    fn condition_accepts_and_rejects_values() {
        let cases = [
            (Expectation::Equals(3), 3, 2),
            (Expectation::Masked { value: 0x12, mask: 0xF2 }, 0x1E, 0x22),
            (Expectation::AtLeast(3), 3, 2),
            (Expectation::AtMost(3), 3, 4),
            (Expectation::HasBits(0x12), 0x1F, 0x02),
            (Expectation::HasAny(0x12), 0x02, 0x01),
            (Expectation::OneOf(&[1, 5]), 5, 2),
        ];
        for (expectation, accepted, rejected) in cases {
            assert!(expectation.is_met_by(accepted), "{expectation} accepts {accepted}");
            assert!(!expectation.is_met_by(rejected), "{expectation} rejects {rejected}");
        }
    }

    #[test]
    fn alternate_form_is_hexadecimal() {
        let expectation = Expectation::AtLeast(128);
        assert_eq!(expectation.to_string(), "at least 128");
        assert_eq!(std::format!("{expectation:#}"), "at least 0x80");
    }

    #[test]
    fn steps_name_their_object_action_and_purpose() {
        let time = Duration::from_millis(20);
        let steps: [(Step<&str>, Option<u16>, &str); 7] = [
            (Step::write(0x1017, 0, 500_u16), Some(0x1017), "write 0x1017:00 = 0x01F4"),
            (Step::modify(0x1005, 0, 1, 2), Some(0x1005), "change 0x1005:00"),
            (Step::read(0x1018, 0x0A), Some(0x1018), "read 0x1018:0A"),
            (Step::expect(0x8010, 2, 0_u8), Some(0x8010), "check 0x8010:02"),
            (Step::await_value(0x6041, 0, 1_u16, time), Some(0x6041), "wait for 0x6041:00"),
            (Step::pause(time), None, "wait 20 ms"),
            (Step::device("set the node ID"), None, "set the node ID"),
        ];
        for (step, index, text) in steps {
            assert_eq!((step.action.index(), step.action.to_string().as_str()), (index, text));
            assert_eq!(step.named("purpose"), Step { purpose: "purpose", ..step });
        }
        let (expected, waited) = (Expectation::Equals(1), Duration::from_millis(300));
        let error =
            StepError::<core::convert::Infallible>::TimedOut { found: 17, expected, waited };
        assert_eq!(error.to_string(), "value is 0x11 after 300 ms, expected 0x1");
    }
}
