//! Condition on the value of an object.

use core::fmt;

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

#[cfg(test)]
mod tests {
    extern crate std;

    use super::Expectation;
    use std::string::ToString as _;

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
}
