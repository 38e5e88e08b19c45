//! One step of a slave's startup.

use std::fmt;

use ecan_protocol::object::SdoWrite;

/// Condition on the value of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expectation {
    /// Exactly this value.
    Equals(u32),
    /// At least this value.
    AtLeast(u32),
    /// At most this value.
    AtMost(u32),
    /// All of these bits; other bits are ignored.
    HasBits(u32),
    /// At least one of these bits.
    HasAny(u32),
    /// One of these values.
    OneOf(&'static [u32]),
}

impl Expectation {
    /// Returns whether `value` meets the condition.
    pub fn is_met_by(self, value: u32) -> bool {
        match self {
            Self::Equals(wanted) => value == wanted,
            Self::AtLeast(least) => value >= least,
            Self::AtMost(most) => value <= most,
            Self::HasBits(bits) => value & bits == bits,
            Self::HasAny(bits) => value & bits != 0,
            Self::OneOf(values) => values.contains(&value),
        }
    }
}

impl fmt::Display for Expectation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Equals(wanted) => write!(f, "{wanted}"),
            Self::AtLeast(least) => write!(f, "at least {least}"),
            Self::AtMost(most) => write!(f, "at most {most}"),
            Self::HasBits(bits) => write!(f, "the bits 0x{bits:X}"),
            Self::HasAny(bits) => write!(f, "one of the bits 0x{bits:X}"),
            Self::OneOf(values) => write!(f, "one of {values:?}"),
        }
    }
}

/// One step of a slave's startup, executed in PREOP.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StartupStep {
    /// Writes an object. Also registered with the master, which sends it again at every
    /// reconfiguration of the slave.
    Download(SdoWrite),
    /// Reads an object and fails if it has another value: a capability, or the readback of an apply
    /// command. Executed when the Adapter configures the slave, not when the master reconfigures it
    /// after a loss.
    Expect {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Condition on its value.
        expected: Expectation,
    },
}

impl From<SdoWrite> for StartupStep {
    fn from(write: SdoWrite) -> Self {
        Self::Download(write)
    }
}

impl Default for StartupStep {
    fn default() -> Self {
        Self::Download(SdoWrite::default())
    }
}

impl StartupStep {
    /// A step that expects an object to read `value`.
    pub fn expect(index: u16, subindex: u8, value: u32) -> Self {
        Self::Expect { index, subindex, expected: Expectation::Equals(value) }
    }

    /// Index and subindex of the object.
    pub fn object(&self) -> (u16, u8) {
        match self {
            Self::Download(sdo) => (sdo.index, sdo.subindex),
            Self::Expect { index, subindex, .. } => (*index, *subindex),
        }
    }

    /// Whether the step writes.
    pub fn is_download(&self) -> bool {
        matches!(self, Self::Download(_))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn condition_accepts_and_rejects_values() {
        assert!(Expectation::AtLeast(3).is_met_by(3) && !Expectation::AtLeast(3).is_met_by(2));
        assert!(Expectation::AtMost(3).is_met_by(3) && !Expectation::AtMost(3).is_met_by(4));
        assert!(
            Expectation::HasBits(0x12).is_met_by(0x1F) && !Expectation::HasBits(2).is_met_by(1)
        );
    }
}
