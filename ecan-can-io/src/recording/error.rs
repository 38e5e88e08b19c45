//! Errors of recordings.

use crate::candump::ParseError;

/// Error in a recording.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, {kind}")]
pub struct RecordingError {
    /// Line, from 1.
    pub line: usize,
    /// Kind of error.
    pub kind: RecordingErrorKind,
}

/// Kind of error in a recording.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingErrorKind {
    /// The line belongs to no format.
    #[error(
        "format not recognized; allowed: candump log, candump screen, Vector ASC, PEAK TRC; \
         `ecan replay --format` selects one"
    )]
    UnknownFormat,
    /// Syntax error in a line of candump.
    #[error(transparent)]
    Candump(#[from] ParseError),
    /// A date on candump's screen.
    #[error("date \"{0}\" is invalid; expected YYYY-MM-DD hh:mm:ss.ffffff")]
    Date(String),
    /// The times of the lines add up to more than 64 bits of nanoseconds.
    #[error("time exceeds 64 bits of nanoseconds")]
    TimeRange,
    /// A field is missing.
    #[error("{field} is missing; expected {expected}")]
    Missing {
        /// Name of the field.
        field: &'static str,
        /// Allowed values.
        expected: &'static str,
    },
    /// A field has another value than allowed.
    #[error("{field} \"{text}\" is invalid; expected {expected}")]
    Invalid {
        /// Name of the field.
        field: &'static str,
        /// Text of the field.
        text: String,
        /// Allowed values.
        expected: &'static str,
    },
    /// The data length of a CAN FD frame does not match its DLC.
    #[error("{length} data bytes do not match DLC {dlc}")]
    LengthMismatch {
        /// Length in bytes.
        length: usize,
        /// DLC.
        dlc: u8,
    },
    /// A line of an ASC file for CAN XL.
    #[error("lines of kind CANXL are not supported; export the recording without CAN XL")]
    CanXl,
    /// A TRC file of version 2 without `$COLUMNS`.
    #[error("no line ;$COLUMNS before the first frame, which version 2 of TRC needs")]
    NoColumns,
}
