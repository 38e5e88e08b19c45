//! From a line to a record.

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameError};

use crate::cursor::Cursor;
use crate::error::{ParseError, ParseErrorKind};
use crate::record::{DirectionMark, Record};

/// Marks an error message of SocketCAN in an 8 digit identifier.
const ERROR_MESSAGE_FLAG: u32 = 0x2000_0000;
const FLAG_BRS: u8 = 1;
const FLAG_ESI: u8 = 2;
const FLAG_FDF: u8 = 4;

/// Reads one line; `None` for a blank line or a comment (`#` first).
///
/// The line may end in a line break. Time and space are linear in its length and nothing is
/// allocated.
///
/// # Errors
/// The first thing in the line that the [grammar](crate) does not allow, with its column.
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

fn blank(cursor: &mut Cursor<'_>) -> Result<(), ParseError> {
    if cursor.take_blanks() { Ok(()) } else { Err(cursor.error(ParseErrorKind::Blank)) }
}

fn time(cursor: &mut Cursor<'_>) -> Result<u64, ParseError> {
    let start = *cursor;
    if !cursor.take(b'(') {
        return Err(cursor.error(ParseErrorKind::TimeStart));
    }
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

pub(crate) fn frame(cursor: &mut Cursor<'_>) -> Result<CanFrame, ParseError> {
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
    let start = *cursor;
    let mut id = 0;
    let mut digits = 0;
    while digits < 8
        && let Some(digit) = cursor.take_hex()
    {
        id = id << 4 | u32::from(digit);
        digits += 1;
    }
    if !matches!(digits, 3 | 8) || !cursor.take(b'#') {
        return Err(cursor.error(ParseErrorKind::Identifier));
    }
    let extended = digits == 8;
    CanId::new(id, extended).map_err(|_| {
        start.error(if extended && id & ERROR_MESSAGE_FLAG != 0 {
            ParseErrorKind::ErrorMessage
        } else {
            ParseErrorKind::IdentifierRange { id }
        })
    })
}

fn remote_frame(cursor: &mut Cursor<'_>, id: CanId) -> Result<CanFrame, ParseError> {
    let start = *cursor;
    let refused = || start.error(ParseErrorKind::RemoteDlc);
    // `R` may stand alone; behind it only a digit can follow, or the end of the word.
    let value = match cursor.peek() {
        Some(b' ' | b'\t' | b'\r' | b'\n') | None => 0,
        Some(_) => cursor.take_decimal().ok_or_else(refused)?,
    };
    let dlc = Dlc::new(value).ok_or_else(refused)?;
    let frame = CanFrame::remote(id, dlc).map_err(|_| refused())?;
    if value == 8 {
        raw_dlc(cursor)?;
    }
    Ok(frame)
}

/// Takes the DLC of a classic frame where the bus had one above 8, which means 8 bytes.
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
        return Err(start.error(ParseErrorKind::UnknownFlags { flags }));
    }
    let start = *cursor;
    let mut buffer = [0; 64];
    let data = data(cursor, &mut buffer)?;
    CanFrame::fd(id, data, flags & FLAG_BRS != 0, flags & FLAG_ESI != 0)
        .map_err(|error| length_error(&start, error))
}

fn length_error(start: &Cursor<'_>, error: FrameError) -> ParseError {
    start.error(match error {
        FrameError::Length { length, .. } => ParseErrorKind::DataLength { length: length as u8 },
        _ => ParseErrorKind::Data,
    })
}

/// Data bytes up to the end of the word, or to the DLC of a full classic frame.
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
            return Err(start.error(ParseErrorKind::DataTooLong { limit }));
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
