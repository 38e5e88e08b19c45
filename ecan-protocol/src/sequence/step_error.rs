//! Failure of one step.

use core::fmt;
use core::time::Duration;

use thiserror::Error;

use super::expectation::Expectation;

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
