//! Parser of log lines and frames.

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameError};

use crate::candump::cursor::Cursor;
use crate::candump::error::{ParseError, ParseErrorKind};
use crate::candump::record::{DirectionMark, Record};

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
    let dlc = Dlc::new(value).ok_or_else(invalid)?;
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
