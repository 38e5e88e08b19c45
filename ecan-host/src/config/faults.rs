//! All that is wrong with a configuration, as one error.

use std::fmt;

/// Every fault of a configuration, in the order of its fields.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Faults<F>(pub Vec<F>);

impl<F> Faults<F> {
    /// The outcome of a check that found these faults.
    ///
    /// # Errors
    /// The faults, if there are any.
    pub fn check(faults: Vec<F>) -> Result<(), Self> {
        if faults.is_empty() { Ok(()) } else { Err(Self(faults)) }
    }
}

impl<F: fmt::Display> fmt::Display for Faults<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.as_slice() {
            [one] => write!(f, "{one}"),
            all => {
                write!(f, "{} faults in the configuration", all.len())?;
                all.iter().try_for_each(|fault| write!(f, "\n  - {fault}"))
            }
        }
    }
}

impl<F: fmt::Debug + fmt::Display> std::error::Error for Faults<F> {}
