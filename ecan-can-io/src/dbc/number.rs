//! Physical values.

use core::fmt;

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
