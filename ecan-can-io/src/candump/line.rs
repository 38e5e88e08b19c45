//! Log lines of candump and frames in the form of cansend: parser, text, filter.

use core::fmt;
use core::str::FromStr;

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameError, FrameKind};
use thiserror::Error;

/// Flag of a SocketCAN error message in an 8 digit CAN ID.
const ERROR_MESSAGE_FLAG: u32 = 0x2000_0000;
const FLAG_BRS: u8 = 1;
const FLAG_ESI: u8 = 2;
const FLAG_FDF: u8 = 4;

/// Parses one line; returns `None` for a blank line or a comment (starts with `#`).
///
/// The line may end with a line break. Does not allocate; time is linear in the line length.
///
/// # Errors
/// The first violation of the [grammar](crate), with its column.
pub fn parse_line(line: &str) -> Result<Option<Record<'_>>, ParseError> {
    let mut cursor = Cursor::new(line);
    cursor.take_blanks();
    if cursor.at_end() || cursor.peek() == Some(b'#') {
        return Ok(None);
    }
    let time_ns = time(&mut cursor)?;
    blank(&mut cursor)?;
    if cursor.at_end() {
        return Err(cursor.error(ParseErrorKind::Interface));
    }
    let interface = cursor.take_word();
    blank(&mut cursor)?;
    let frame = frame(&mut cursor)?;
    let direction = direction(&mut cursor)?;
    Ok(Some(Record { time_ns, interface, frame, direction }))
}

/// Parses a frame without time stamp and interface, for example `123#DEADBEEF`.
///
/// # Errors
/// The first violation of the [grammar](crate) of `frame`, with its column.
pub fn parse_frame(text: &str) -> Result<CanFrame, ParseError> {
    let mut cursor = Cursor::new(text);
    let frame = frame(&mut cursor)?;
    if cursor.at_end() { Ok(frame) } else { Err(cursor.error(ParseErrorKind::Trailing)) }
}

pub(crate) fn blank(cursor: &mut Cursor<'_>) -> Result<(), ParseError> {
    if cursor.take_blanks() { Ok(()) } else { Err(cursor.error(ParseErrorKind::Blank)) }
}

fn time(cursor: &mut Cursor<'_>) -> Result<u64, ParseError> {
    let start = *cursor;
    if !cursor.take(b'(') {
        return Err(cursor.error(ParseErrorKind::TimeStart));
    }
    time_in_brackets(cursor, &start)
}

/// Parses a time after its `(`, which is at `start`.
pub(crate) fn time_in_brackets(
    cursor: &mut Cursor<'_>,
    start: &Cursor<'_>,
) -> Result<u64, ParseError> {
    let too_late = || start.error(ParseErrorKind::TimeRange);
    let mut seconds: Option<u64> = None;
    while let Some(digit) = cursor.take_decimal() {
        let value = seconds.unwrap_or(0);
        let next = value.checked_mul(10).and_then(|v| v.checked_add(u64::from(digit)));
        seconds = Some(next.ok_or_else(too_late)?);
    }
    let Some(seconds) = seconds else {
        return Err(cursor.error(ParseErrorKind::Seconds));
    };
    if !cursor.take(b'.') {
        return Err(cursor.error(ParseErrorKind::Seconds));
    }
    let mut fraction = 0;
    let mut digits = 0;
    while digits < 9
        && let Some(digit) = cursor.take_decimal()
    {
        fraction = fraction * 10 + u64::from(digit);
        digits += 1;
    }
    let nanoseconds = match digits {
        6 => fraction * 1000,
        9 => fraction,
        _ => return Err(cursor.error(ParseErrorKind::Fraction)),
    };
    if !cursor.take(b')') {
        return Err(cursor.error(ParseErrorKind::Fraction));
    }
    seconds.checked_mul(1_000_000_000).and_then(|v| v.checked_add(nanoseconds)).ok_or_else(too_late)
}

fn frame(cursor: &mut Cursor<'_>) -> Result<CanFrame, ParseError> {
    let id = identifier(cursor)?;
    if cursor.take(b'#') {
        return fd_frame(cursor, id);
    }
    if cursor.take(b'R') {
        return remote_frame(cursor, id);
    }
    let start = *cursor;
    let mut buffer = [0; 8];
    let data = data(cursor, &mut buffer)?;
    if data.len() == 8 {
        raw_dlc(cursor)?;
    }
    CanFrame::classic(id, data).map_err(|error| length_error(&start, error))
}

fn identifier(cursor: &mut Cursor<'_>) -> Result<CanId, ParseError> {
    identifier_before(cursor, |cursor| cursor.take(b'#'))
}

/// Parses a CAN ID that is followed by what `take_end` takes.
pub(crate) fn identifier_before<'a>(
    cursor: &mut Cursor<'a>,
    take_end: impl FnOnce(&mut Cursor<'a>) -> bool,
) -> Result<CanId, ParseError> {
    let start = *cursor;
    let mut id = 0;
    let mut digits = 0;
    while digits < 8
        && let Some(digit) = cursor.take_hex()
    {
        id = id << 4 | u32::from(digit);
        digits += 1;
    }
    if !matches!(digits, 3 | 8) || !take_end(cursor) {
        return Err(cursor.error(ParseErrorKind::Identifier));
    }
    let extended = digits == 8;
    CanId::new(id, extended).map_err(|_| {
        start.error(if extended && id & ERROR_MESSAGE_FLAG != 0 {
            ParseErrorKind::ErrorMessage
        } else {
            ParseErrorKind::IdentifierRange(id)
        })
    })
}

fn remote_frame(cursor: &mut Cursor<'_>, id: CanId) -> Result<CanFrame, ParseError> {
    let start = *cursor;
    let invalid = || start.error(ParseErrorKind::RemoteDlc);
    let value = match cursor.peek() {
        Some(b' ' | b'\t' | b'\r' | b'\n') | None => 0,
        Some(_) => cursor.take_decimal().ok_or_else(invalid)?,
    };
    let dlc = Dlc::from_raw(value).ok_or_else(invalid)?;
    let frame = CanFrame::remote(id, dlc).map_err(|_| invalid())?;
    if value == 8 {
        raw_dlc(cursor)?;
    }
    Ok(frame)
}

/// Skips the raw DLC (9 to F) of a classic frame with 8 bytes.
fn raw_dlc(cursor: &mut Cursor<'_>) -> Result<(), ParseError> {
    if !cursor.take(b'_') {
        return Ok(());
    }
    let start = *cursor;
    let is_raw = cursor.take_hex().is_some_and(|dlc| dlc > 8);
    if is_raw { Ok(()) } else { Err(start.error(ParseErrorKind::RawDlc)) }
}

fn fd_frame(cursor: &mut Cursor<'_>, id: CanId) -> Result<CanFrame, ParseError> {
    let start = *cursor;
    let Some(flags) = cursor.take_hex() else {
        return Err(cursor.error(ParseErrorKind::Flags));
    };
    if flags & !(FLAG_BRS | FLAG_ESI | FLAG_FDF) != 0 {
        return Err(start.error(ParseErrorKind::UnknownFlags(flags)));
    }
    let start = *cursor;
    let mut buffer = [0; 64];
    let data = data(cursor, &mut buffer)?;
    CanFrame::fd(id, data, flags & FLAG_BRS != 0, flags & FLAG_ESI != 0)
        .map_err(|error| length_error(&start, error))
}

fn length_error(start: &Cursor<'_>, error: FrameError) -> ParseError {
    start.error(match error {
        FrameError::Length { length, .. } => ParseErrorKind::DataLength(length as u8),
        _ => ParseErrorKind::Data,
    })
}

/// Parses data bytes up to the end of the word or to the raw DLC of a classic frame.
fn data<'b>(cursor: &mut Cursor<'_>, buffer: &'b mut [u8]) -> Result<&'b [u8], ParseError> {
    let limit = buffer.len() as u8;
    let mut length = 0;
    while !matches!(cursor.peek(), Some(b' ' | b'\t' | b'\r' | b'\n') | None) {
        if length == 8 && limit == 8 && cursor.peek() == Some(b'_') {
            break;
        }
        let start = *cursor;
        let (Some(high), Some(low)) = (cursor.take_hex(), cursor.take_hex()) else {
            return Err(cursor.error(ParseErrorKind::Data));
        };
        let Some(byte) = buffer.get_mut(length) else {
            return Err(start.error(ParseErrorKind::DataTooLong(limit)));
        };
        *byte = high << 4 | low;
        length += 1;
    }
    Ok(buffer.get(..length).unwrap_or_default())
}

fn direction(cursor: &mut Cursor<'_>) -> Result<Option<DirectionMark>, ParseError> {
    cursor.take_blanks();
    let start = *cursor;
    let mark = match cursor.take_word() {
        "" => return Ok(None),
        "R" => DirectionMark::Received,
        "T" => DirectionMark::Transmitted,
        _ => return Err(start.error(ParseErrorKind::Trailing)),
    };
    cursor.take_blanks();
    if cursor.at_end() { Ok(Some(mark)) } else { Err(cursor.error(ParseErrorKind::Trailing)) }
}

/// Read position in a line.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cursor<'a> {
    line: &'a str,
    /// Byte offset, always on a character boundary: only words and ASCII characters are taken.
    offset: usize,
}

impl<'a> Cursor<'a> {
    pub(crate) const fn new(line: &'a str) -> Self {
        Self { line, offset: 0 }
    }

    pub(crate) fn rest(&self) -> &'a str {
        self.line.get(self.offset..).unwrap_or_default()
    }

    pub(crate) fn peek(&self) -> Option<u8> {
        self.line.as_bytes().get(self.offset).copied()
    }

    pub(crate) fn at_end(&self) -> bool {
        self.offset >= self.line.len()
    }

    /// Skips the ASCII character returned by `peek`.
    pub(crate) fn skip(&mut self) {
        self.offset += 1;
    }

    /// Takes the ASCII character `wanted` if it is next.
    pub(crate) fn take(&mut self, wanted: u8) -> bool {
        let found = self.peek() == Some(wanted);
        if found {
            self.skip();
        }
        found
    }

    pub(crate) fn take_blanks(&mut self) -> bool {
        let before = self.offset;
        while self.peek().is_some_and(is_blank) {
            self.skip();
        }
        self.offset > before
    }

    /// Takes everything up to the next blank.
    pub(crate) fn take_word(&mut self) -> &'a str {
        let rest = self.rest();
        let length = rest.bytes().position(is_blank).unwrap_or(rest.len());
        self.offset += length;
        rest.get(..length).unwrap_or_default()
    }

    pub(crate) fn take_decimal(&mut self) -> Option<u8> {
        self.take_digit(10)
    }

    pub(crate) fn take_hex(&mut self) -> Option<u8> {
        self.take_digit(16)
    }

    fn take_digit(&mut self, radix: u32) -> Option<u8> {
        let value = char::from(self.peek()?).to_digit(radix)?;
        self.skip();
        Some(value as u8)
    }

    pub(crate) fn error(&self, kind: ParseErrorKind) -> ParseError {
        let before = self.line.get(..self.offset).unwrap_or(self.line);
        ParseError { kind, column: before.chars().count() + 1 }
    }
}

const fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r' | b'\n')
}

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

/// Formats a frame as in candump logs and for `cansend`, for example `123#DEADBEEF`.
#[derive(Clone, Copy, Debug)]
pub struct FrameText<'a>(pub &'a CanFrame);

impl fmt::Display for FrameText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(frame) = self;
        let id = frame.id();
        if id.is_extended() {
            write!(f, "{:08X}#", id.raw())?;
        } else {
            write!(f, "{:03X}#", id.raw())?;
        }
        match frame.kind() {
            FrameKind::Data => {}
            FrameKind::Remote => {
                f.write_str("R")?;
                let dlc = frame.dlc().value();
                if dlc > 0 {
                    write!(f, "{dlc}")?;
                }
            }
            FrameKind::Fd { brs, esi } => {
                write!(f, "#{}", u8::from(brs) | u8::from(esi) << 1)?;
            }
        }
        for byte in frame.data() {
            write!(f, "{byte:02X}")?;
        }
        Ok(())
    }
}

// SocketCAN flags in the word of the CAN ID: extended format, remote frame, error message.
const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
const ERROR: u32 = 0x2000_0000;
/// Number of hex digits of an extended CAN ID.
const EXTENDED_DIGITS: usize = 8;

/// Invalid filter text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("expected ID:MASK or ID~MASK in hexadecimal, as in 123:7FF")]
pub struct FilterError;

/// Frame filter by CAN ID and mask, both hexadecimal: `ID:MASK` passes frames whose CAN ID equals
/// `ID` in the bits of the mask, `ID~MASK` passes the others.
///
/// As in the kernel, bit 31 is the extended format and bit 30 a remote frame. An `ID` of 8 digits is
/// extended. `123:7FF` also passes an extended CAN ID with the same lower bits; `123:C00007FF` does
/// not.
///
/// ```
/// use ecan_can_io::candump::{Filter, parse_frame};
///
/// let filter: Filter = "120:7F0".parse()?;
/// assert!(filter.passes(&parse_frame("123#")?));
/// assert!(!filter.passes(&parse_frame("133#")?));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter {
    id: u32,
    mask: u32,
    is_inverted: bool,
}

impl Filter {
    /// Returns whether a frame passes.
    #[must_use]
    pub fn passes(&self, frame: &CanFrame) -> bool {
        let id = frame.id();
        let format = if id.is_extended() { EXTENDED } else { 0 };
        let kind = if frame.kind() == FrameKind::Remote { REMOTE } else { 0 };
        let agrees = ((id.raw() | format | kind) ^ self.id) & self.mask == 0;
        agrees != self.is_inverted
    }
}

impl FromStr for Filter {
    type Err = FilterError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let is_inverted = text.contains('~');
        let (id, mask) = text.split_once([':', '~']).ok_or(FilterError)?;
        let format = if id.len() == EXTENDED_DIGITS { EXTENDED } else { 0 };
        Ok(Self { id: hexadecimal(id)? | format, mask: hexadecimal(mask)? & !ERROR, is_inverted })
    }
}

fn hexadecimal(digits: &str) -> Result<u32, FilterError> {
    let is_number = digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    match u32::from_str_radix(digits, 16) {
        Ok(number) if is_number => Ok(number),
        _ => Err(FilterError),
    }
}

/// Direction of a frame, as `candump -x` marks it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DirectionMark {
    /// `R`: received.
    Received,
    /// `T`: sent by the recording host.
    Transmitted,
}

/// One recorded frame.
///
/// `Display` writes the line: 6 decimals, or 9 if the time is not a whole number of microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record<'a> {
    /// Time in nanoseconds; candump counts from 1970 by default.
    pub time_ns: u64,
    /// Name of the CAN interface. Must be non-empty and without blanks for a line that
    /// [`parse_line`](super::parse_line) accepts.
    pub interface: &'a str,
    /// The frame.
    pub frame: CanFrame,
    /// Direction mark, if present.
    pub direction: Option<DirectionMark>,
}

impl fmt::Display for Record<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.time_ns / 1_000_000_000;
        let fraction = self.time_ns % 1_000_000_000;
        if fraction.is_multiple_of(1000) {
            write!(f, "({seconds:010}.{:06})", fraction / 1000)?;
        } else {
            write!(f, "({seconds:010}.{fraction:09})")?;
        }
        write!(f, " {} {}", self.interface, FrameText(&self.frame))?;
        match self.direction {
            None => Ok(()),
            Some(DirectionMark::Received) => f.write_str(" R"),
            Some(DirectionMark::Transmitted) => f.write_str(" T"),
        }
    }
}
