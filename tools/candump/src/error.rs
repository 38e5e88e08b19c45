//! What can be wrong with a line.

/// Why a line is not a record, and where.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("column {column}: {kind}")]
pub struct ParseError {
    /// What is wrong.
    pub kind: ParseErrorKind,
    /// Where, counted in characters from 1. One past the last character when the line is too
    /// short.
    pub column: usize,
}

/// What is wrong with a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParseErrorKind {
    /// The line does not begin with a time stamp.
    #[error("expected `(` and a time stamp")]
    TimeStart,
    /// No digits where the seconds of the time stamp stand, or another character among them.
    #[error("expected the seconds of the time stamp, then `.`")]
    Seconds,
    /// The fraction has neither 6 nor 9 digits.
    #[error("expected 6 or 9 decimals of the time stamp, then `)`")]
    Fraction,
    /// The time does not fit 64 bits of nanoseconds.
    #[error("the time stamp is beyond 64 bits of nanoseconds")]
    TimeRange,
    /// A blank is missing between two fields.
    #[error("expected a blank")]
    Blank,
    /// The line ends where the interface should stand.
    #[error("expected the name of an interface")]
    Interface,
    /// The identifier has neither 3 nor 8 hex digits, or is not followed by `#`.
    #[error("expected an identifier of 3 or 8 hex digits, then `#`")]
    Identifier,
    /// A 3 digit identifier beyond 7FF or an 8 digit one beyond 1FFFFFFF.
    #[error("the identifier {id:X} does not fit its format")]
    IdentifierRange {
        /// The value read.
        id: u32,
    },
    /// An error message of SocketCAN (bit 29 of the identifier): no frame of the bus.
    #[error("an error message of the CAN interface, not a frame")]
    ErrorMessage,
    /// The character behind `##` is no hex digit.
    #[error("expected the flags of a CAN FD frame, one hex digit")]
    Flags,
    /// Flag bits that no one has defined.
    #[error("CAN FD flags {flags:X}: only bits 0 (BRS), 1 (ESI) and 2 (FDF) are known")]
    UnknownFlags {
        /// The digit read.
        flags: u8,
    },
    /// A data byte is not two hex digits.
    #[error("expected data bytes of two hex digits each")]
    Data,
    /// More data bytes than the format has.
    #[error("more than {limit} data bytes")]
    DataTooLong {
        /// Most data bytes of this format.
        limit: u8,
    },
    /// A CAN FD frame of a length that no DLC stands for.
    #[error("no DLC of CAN FD stands for {length} data bytes")]
    DataLength {
        /// Data bytes read.
        length: u8,
    },
    /// The DLC of a remote frame is no digit from 0 to 8.
    #[error("expected the DLC of a remote frame, 0 to 8")]
    RemoteDlc,
    /// The raw DLC of a classic frame is no digit from 9 to F.
    #[error("expected the raw DLC of a frame of 8 bytes, 9 to F")]
    RawDlc,
    /// Something other than a direction mark behind the frame.
    #[error("expected the end of the line, or a direction mark R or T")]
    Trailing,
}
