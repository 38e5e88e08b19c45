//! Errors of the parser.

/// Syntax error in a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("column {column}: {kind}")]
pub struct ParseError {
    /// Kind of error.
    pub kind: ParseErrorKind,
    /// Column in characters, from 1; one past the last character if the line is too short.
    pub column: usize,
}

/// Kind of syntax error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParseErrorKind {
    /// The line does not start with a time stamp.
    #[error("expected `(` and a time stamp")]
    TimeStart,
    /// The seconds of the time stamp are missing or contain other characters.
    #[error("expected the seconds of the time stamp, then `.`")]
    Seconds,
    /// The fraction has neither 6 nor 9 digits.
    #[error("expected 6 or 9 decimals of the time stamp, then `)`")]
    Fraction,
    /// The time does not fit 64 bits of nanoseconds.
    #[error("time stamp exceeds 64 bits of nanoseconds")]
    TimeRange,
    /// A blank is missing between two fields.
    #[error("expected a blank")]
    Blank,
    /// The line ends before the interface.
    #[error("expected the name of an interface")]
    Interface,
    /// The CAN ID has neither 3 nor 8 hex digits, or is not followed by `#`.
    #[error("expected a CAN ID of 3 or 8 hex digits, then `#`")]
    Identifier,
    /// A 3 digit CAN ID above 7FF or an 8 digit one above 1FFFFFFF.
    #[error("CAN ID {0:X} is out of range; allowed: 000 to 7FF, 00000000 to 1FFFFFFF")]
    IdentifierRange(u32),
    /// A SocketCAN error message (bit 29 of the CAN ID), not a CAN frame.
    #[error("SocketCAN error message; not a CAN frame")]
    ErrorMessage,
    /// The character after `##` is not a hex digit.
    #[error("expected the flags of a CAN FD frame, one hex digit")]
    Flags,
    /// Undefined flag bits.
    #[error("CAN FD flags {0:X} are invalid; allowed: bits 0 (BRS), 1 (ESI) and 2 (FDF)")]
    UnknownFlags(u8),
    /// A data byte is not two hex digits.
    #[error("expected data bytes of two hex digits each")]
    Data,
    /// Too many data bytes for the format.
    #[error("more than {0} data bytes")]
    DataTooLong(u8),
    /// Length of a CAN FD frame without a matching DLC.
    #[error("{0} data bytes have no CAN FD DLC; allowed: 0 to 8, 12, 16, 20, 24, 32, 48, 64")]
    DataLength(u8),
    /// The DLC of a remote frame is not a digit from 0 to 8.
    #[error("expected the DLC of a remote frame, 0 to 8")]
    RemoteDlc,
    /// The raw DLC of a classic frame is not a digit from 9 to F.
    #[error("expected the raw DLC of a frame of 8 bytes, 9 to F")]
    RawDlc,
    /// The CAN ID on the screen has neither 3 nor 8 hex digits.
    #[error("expected a CAN ID of 3 or 8 hex digits")]
    ScreenIdentifier,
    /// The length on the screen is not `[n]` or `[nn]`.
    #[error("expected the length in brackets, [0] to [8], or [00] to [64] for CAN FD")]
    ScreenLength,
    /// The screen shows another number of data bytes than the length in brackets.
    #[error("expected {0} data bytes of two hex digits each")]
    ScreenData(u8),
    /// Text other than a direction mark after the frame.
    #[error("expected the end of the line, or a direction mark R or T")]
    Trailing,
}
