//! One step of a configuration.

use core::fmt;
use core::time::Duration;

use super::expectation::Expectation;
use super::object_access::NoAction;
use super::sdo_value::SdoValue;
use crate::object::{AbortCode, SdoWrite};

/// Failures that do not end the sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tolerance {
    /// None: the step must succeed.
    #[default]
    None,
    /// The object or subindex does not exist.
    Missing,
    /// Any abort by the device, or a value other than the expected one.
    Any,
}

impl Tolerance {
    pub(super) fn covers(self, code: AbortCode) -> bool {
        match self {
            Self::None => false,
            Self::Missing => matches!(code, AbortCode::NO_OBJECT | AbortCode::NO_SUBINDEX),
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
