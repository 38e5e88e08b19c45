//! Text of a frame in the columns of candump.

use core::fmt;

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameKind};

use super::line::{
    Cursor, DirectionMark, ParseError, ParseErrorKind, blank, identifier_before, time_in_brackets,
};

/// Longest frame whose ASCII characters are shown, in bytes.
const ASCII_BYTES: usize = 8;

/// Formats a frame in candump's columns: CAN ID, length in brackets, bytes.
///
/// ```
/// use ecan_can_io::candump::{ScreenFrame, parse_frame};
///
/// let frame = parse_frame("123#DEADBEEF")?;
/// assert_eq!(ScreenFrame::new(&frame).to_string(), "123   [4]  DE AD BE EF");
/// # Ok::<(), ecan_can_io::candump::ParseError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ScreenFrame<'a> {
    /// The frame.
    pub frame: &'a CanFrame,
    /// Align standard CAN IDs with the last digits of extended ones, as candump does after the first
    /// extended frame.
    pub is_indented: bool,
    /// Append the ASCII characters of frames of at most 8 bytes (`candump -a`).
    pub has_ascii: bool,
}

impl<'a> ScreenFrame<'a> {
    /// Formats without indentation and ASCII characters.
    #[must_use]
    pub const fn new(frame: &'a CanFrame) -> Self {
        Self { frame, is_indented: false, has_ascii: false }
    }
}

impl fmt::Display for ScreenFrame<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frame, is_indented, has_ascii } = *self;
        let id = frame.id();
        match (id.is_extended(), is_indented) {
            (true, _) => write!(f, "{:08X}  ", id.raw())?,
            (false, true) => write!(f, "     {:03X}  ", id.raw())?,
            (false, false) => write!(f, "{:03X}  ", id.raw())?,
        }
        let data = frame.data();
        match frame.kind() {
            FrameKind::Fd { .. } => write!(f, "[{:02}] ", data.len())?,
            FrameKind::Data => write!(f, " [{}] ", data.len())?,
            FrameKind::Remote => {
                return write!(f, " [{}]  remote request", frame.dlc().value());
            }
        }
        for byte in data {
            write!(f, " {byte:02X}")?;
        }
        if has_ascii && data.len() <= ASCII_BYTES {
            write!(f, "{:>1$}", "'", 3 * (ASCII_BYTES - data.len()) + 4)?;
            for byte in data {
                let is_visible = (0x20..0x7F).contains(byte);
                write!(f, "{}", if is_visible { char::from(*byte) } else { '.' })?;
            }
            f.write_str("'")?;
        }
        Ok(())
    }
}

const CLASSIC_BYTES: u8 = 8;
/// Blanks before a line that describes the frame above.
const DETAIL_BLANKS: usize = 4;

/// Time stamp of a line on the screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScreenTime<'a> {
    /// Nanoseconds: since 1970 (`-t a`), since the first frame (`-t z`) or since the frame before
    /// (`-t d`). The line does not show which.
    Nanoseconds(u64),
    /// Local date and time of day (`-t A`), as in `2014-04-22 00:57:03.803317`.
    Date(&'a str),
}

/// One frame on the screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScreenRecord<'a> {
    /// Time stamp, if present.
    pub time: Option<ScreenTime<'a>>,
    /// Name of the CAN interface.
    pub interface: &'a str,
    /// The frame. Without `-x` the screen does not show the bits BRS and ESI of CAN FD: both are 0.
    pub frame: CanFrame,
    /// Direction (`-x`), if present.
    pub direction: Option<DirectionMark>,
}

/// Parses a line of candump's screen; returns `None` for a blank line, a comment or a detail of the
/// frame above.
///
/// The line may end with a line break. Does not allocate; time is linear in the line length.
///
/// ```
/// let line = " (000.020000)  can0  123   [4]  DE AD BE EF";
/// let record = ecan_can_io::candump::parse_screen_line(line)?.expect("a record");
/// assert_eq!(record.time, Some(ecan_can_io::candump::ScreenTime::Nanoseconds(20_000_000)));
/// assert_eq!(record.frame.data(), [0xDE, 0xAD, 0xBE, 0xEF]);
/// # Ok::<(), ecan_can_io::candump::ParseError>(())
/// ```
///
/// # Errors
/// The first violation of the [grammar](crate) of `screen`, with its column. The kind is
/// [`ErrorMessage`](ParseErrorKind::ErrorMessage) for an error message (`-e`).
pub fn parse_screen_line(line: &str) -> Result<Option<ScreenRecord<'_>>, ParseError> {
    let blanks = line.len() - line.trim_start_matches(' ').len();
    let mut cursor = Cursor::new(line);
    cursor.take_blanks();
    let is_detail = blanks >= DETAIL_BLANKS || line.starts_with('\t');
    if is_detail || cursor.at_end() || cursor.peek() == Some(b'#') {
        return Ok(None);
    }
    let time = time(&mut cursor)?;
    if cursor.at_end() {
        return Err(cursor.error(ParseErrorKind::Interface));
    }
    let interface = cursor.take_word();
    blank(&mut cursor)?;
    let flags = flags(&mut cursor)?;
    let id = identifier_before(&mut cursor, Cursor::take_blanks).map_err(|error| {
        let is_syntax = error.kind == ParseErrorKind::Identifier;
        ParseError {
            kind: if is_syntax { ParseErrorKind::ScreenIdentifier } else { error.kind },
            ..error
        }
    })?;
    let (brs, esi) = flags.map_or((false, false), |flags| (flags.brs, flags.esi));
    let frame = frame(&mut cursor, id, brs, esi)?;
    let direction = flags.map(|flags| flags.direction);
    Ok(Some(ScreenRecord { time, interface, frame, direction }))
}

fn time<'a>(cursor: &mut Cursor<'a>) -> Result<Option<ScreenTime<'a>>, ParseError> {
    let start = *cursor;
    if !cursor.take(b'(') {
        return Ok(None);
    }
    let rest = cursor.rest();
    let is_date = rest.bytes().take_while(|byte| *byte != b')').any(|byte| byte == b'-');
    let time = if is_date {
        let end = rest.split_once(')');
        let (date, _) = end.ok_or_else(|| start.error(ParseErrorKind::Fraction))?;
        while !cursor.take(b')') {
            cursor.skip();
        }
        ScreenTime::Date(date)
    } else {
        ScreenTime::Nanoseconds(time_in_brackets(cursor, &start)?)
    };
    blank(cursor)?;
    Ok(Some(time))
}

#[derive(Clone, Copy)]
struct Flags {
    direction: DirectionMark,
    brs: bool,
    esi: bool,
}

fn flags(cursor: &mut Cursor<'_>) -> Result<Option<Flags>, ParseError> {
    let start = *cursor;
    let direction = match cursor.take_word() {
        "RX" => DirectionMark::Received,
        "TX" => DirectionMark::Transmitted,
        _ => {
            *cursor = start;
            return Ok(None);
        }
    };
    let mut mark = |letter: &str| {
        blank(cursor)?;
        let start = *cursor;
        match cursor.take_word() {
            "-" => Ok(false),
            word if word == letter => Ok(true),
            _ => Err(start.error(ParseErrorKind::Flags)),
        }
    };
    let (brs, esi) = (mark("B")?, mark("E")?);
    blank(cursor)?;
    Ok(Some(Flags { direction, brs, esi }))
}

fn frame(cursor: &mut Cursor<'_>, id: CanId, brs: bool, esi: bool) -> Result<CanFrame, ParseError> {
    let start = *cursor;
    let (length, is_fd) = length(cursor)?;
    if !is_fd && cursor.rest().trim() == "remote request" {
        let invalid = || start.error(ParseErrorKind::RemoteDlc);
        let dlc = Dlc::from_raw(length).ok_or_else(invalid)?;
        return CanFrame::remote(id, dlc).map_err(|_| invalid());
    }
    let mut buffer = [0; 64];
    let data = buffer.get_mut(..length.into()).unwrap_or_default();
    for byte in &mut *data {
        let missing = |cursor: &Cursor<'_>| cursor.error(ParseErrorKind::ScreenData(length));
        if !cursor.take_blanks() {
            return Err(missing(cursor));
        }
        let digits = (cursor.take_hex(), cursor.take_hex());
        let (Some(high), Some(low)) = digits else { return Err(missing(cursor)) };
        *byte = high << 4 | low;
    }
    let after_data = *cursor;
    let is_separate = cursor.take_blanks();
    let rest = cursor.rest().trim_end();
    let is_time = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let is_ascii = rest.starts_with('\'');
    if !(rest.is_empty()
        || is_separate && (is_ascii || rest.strip_prefix('+').is_some_and(is_time)))
    {
        return Err(after_data.error(ParseErrorKind::ScreenData(length)));
    }
    let frame = if is_fd { CanFrame::fd(id, data, brs, esi) } else { CanFrame::classic(id, data) };
    frame.map_err(|_| start.error(ParseErrorKind::DataLength(length)))
}

/// Parses the length; returns whether the frame is CAN FD.
fn length(cursor: &mut Cursor<'_>) -> Result<(u8, bool), ParseError> {
    let start = *cursor;
    let invalid = || start.error(ParseErrorKind::ScreenLength);
    if !cursor.take(b'[') {
        return Err(invalid());
    }
    let first = cursor.take_decimal().ok_or_else(invalid)?;
    let second = cursor.take_decimal();
    let length = second.map_or(first, |second| first * 10 + second);
    let limit = if second.is_some() { 64 } else { CLASSIC_BYTES };
    if length > limit || !cursor.take(b']') {
        return Err(invalid());
    }
    Ok((length, second.is_some()))
}
