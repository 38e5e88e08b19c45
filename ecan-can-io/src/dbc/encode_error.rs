//! Errors of encoding.

use thiserror::Error;

use crate::dbc::similar::UnknownName;

/// Signal values that give no frame.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("message {message}: {kind}")]
pub struct EncodeError {
    /// Name of the message.
    pub message: String,
    /// Kind of error.
    pub kind: Box<EncodeErrorKind>,
}

/// Kind of error of encoding.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum EncodeErrorKind {
    /// The message has no signal of this name.
    #[error(transparent)]
    Signal(#[from] UnknownName),
    /// A signal is given twice.
    #[error("signal {0} is given twice")]
    Twice(String),
    /// The value is neither a number nor one of the texts.
    #[error("{signal} = {value} is invalid; expected {expected}")]
    Value {
        /// Name of the signal.
        signal: String,
        /// The value.
        value: String,
        /// Allowed values.
        expected: String,
    },
    /// The value is outside the range of the file or of the bits.
    #[error("{signal} = {value} is out of range; allowed: {least} to {most}{unit}")]
    Range {
        /// Name of the signal.
        signal: String,
        /// The value.
        value: String,
        /// Smallest value.
        least: String,
        /// Largest value.
        most: String,
        /// Unit, after a blank; empty without one.
        unit: String,
    },
    /// All values of the signal are equal.
    #[error("{0} has the factor 0 and cannot be set")]
    ZeroFactor(String),
    /// The multiplexer has a value that excludes a given signal.
    #[error(
        "{signal} is in the frame if {multiplexer} is {expected}; given or needed otherwise: {value}"
    )]
    Multiplexer {
        /// Name of the signal.
        signal: String,
        /// Name of its multiplexer.
        multiplexer: String,
        /// Raw values that select the signal.
        expected: String,
        /// Raw value of the multiplexer.
        value: u64,
    },
    /// Another signal of the frame has the same bits.
    #[error("{0} shares bits with another signal of the frame")]
    Overlap(String),
    /// Length that no frame has.
    #[error(
        "{0} bytes are no length of a CAN FD frame; allowed: 0 to 8, 12, 16, 20, 24, 32, 48, 64"
    )]
    Length(usize),
}
