//! Recordings and their frames, the fields of their lines, and errors.

use core::fmt;
use core::str::FromStr;
use std::str::SplitAsciiWhitespace;

use ecan_protocol::can::{CanFrame, CanId, Dlc};
use jiff::civil::DateTime;
use jiff::tz::TimeZone;

use crate::candump::{ParseError, ParseErrorKind, ScreenTime, parse_line, parse_screen_line};

/// Characters of a field in a message.
const MAX_QUOTED: usize = 80;

pub type FieldResult<T> = Result<T, RecordingErrorKind>;

/// Reads the fields of a line in their order.
#[derive(Clone, Debug)]
pub struct Fields<'a>(SplitAsciiWhitespace<'a>);

impl<'a> Fields<'a> {
    pub fn new(line: &'a str) -> Self {
        Self(line.split_ascii_whitespace())
    }

    pub fn next(&mut self) -> Option<&'a str> {
        self.0.next()
    }

    pub fn peek(&self) -> Option<&'a str> {
        self.0.clone().next()
    }

    /// Takes a field that must exist.
    pub fn take(&mut self, field: &'static str, expected: &'static str) -> FieldResult<&'a str> {
        self.next().ok_or(RecordingErrorKind::Missing { field, expected })
    }

    /// Takes a field that must have an allowed value.
    pub fn parse<T>(
        &mut self,
        field: &'static str,
        expected: &'static str,
        parse: impl FnOnce(&str) -> Option<T>,
    ) -> FieldResult<T> {
        let text = self.take(field, expected)?;
        parse(text).ok_or_else(|| invalid(field, text, expected))
    }

    /// Takes data bytes.
    pub fn data<'b>(&mut self, buffer: &'b mut [u8], radix: u32) -> FieldResult<&'b [u8]> {
        let expected = if radix == 16 { "a byte in hexadecimal" } else { "a byte in decimal" };
        for byte in &mut *buffer {
            *byte = self.parse("data byte", expected, |text| byte_of(text, radix))?;
        }
        Ok(buffer)
    }
}

pub fn invalid(field: &'static str, text: &str, expected: &'static str) -> RecordingErrorKind {
    RecordingErrorKind::Invalid { field, text: quoted(text), expected }
}

/// The begin of a text; no control sequence of the file reaches a terminal.
fn quoted(text: &str) -> String {
    let printable = |character: char| {
        if character.is_control() { char::REPLACEMENT_CHARACTER } else { character }
    };
    text.chars().take(MAX_QUOTED).map(printable).collect()
}

fn byte_of(text: &str, radix: u32) -> Option<u8> {
    number(text, radix).and_then(|value| u8::try_from(value).ok())
}

/// Parses an unsigned number without sign.
pub fn number(text: &str, radix: u32) -> Option<u32> {
    let is_number = text.chars().all(|digit| digit.is_digit(radix));
    u32::from_str_radix(text, radix).ok().filter(|_| is_number)
}

/// Parses a decimal fraction in nanoseconds, with at most nine decimals of a unit of
/// `10^digits` nanoseconds.
pub fn time_ns(text: &str, digits: u32) -> Option<u64> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let is_number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if !is_number(whole) || !is_number(fraction) {
        return None;
    }
    let unit = 10_u64.checked_pow(digits)?;
    let whole = whole.parse::<u64>().ok()?.checked_mul(unit)?;
    // Digits below a nanosecond are dropped.
    let fraction = fraction.get(..fraction.len().min(digits as usize)).unwrap_or_default();
    let missing = digits.checked_sub(u32::try_from(fraction.len()).ok()?)?;
    let part = if fraction.is_empty() { 0 } else { fraction.parse::<u64>().ok()? };
    whole.checked_add(part.checked_mul(10_u64.checked_pow(missing)?)?)
}

/// A classic data frame, of which a DLC above 8 has 8 bytes.
pub fn classic(fields: &mut Fields<'_>, id: CanId, dlc: Dlc, radix: u32) -> FieldResult<CanFrame> {
    let mut buffer = [0; 8];
    let data = fields.data(buffer.get_mut(..dlc.classic_len()).unwrap_or_default(), radix)?;
    CanFrame::classic(id, data)
        .map_err(|_| RecordingErrorKind::LengthMismatch { length: data.len(), dlc: dlc.value() })
}

/// A remote frame; a DLC above 8 counts as 8.
pub fn remote(id: CanId, dlc: u8) -> FieldResult<CanFrame> {
    let invalid = || RecordingErrorKind::LengthMismatch { length: 0, dlc };
    let dlc = Dlc::from_raw(dlc.min(8)).ok_or_else(invalid)?;
    CanFrame::remote(id, dlc).map_err(|_| invalid())
}

/// Name of the interface of a channel that counts from 1.
pub fn interface(text: &str) -> Option<String> {
    let channel = number(text, 10)?.checked_sub(1)?;
    Some(format!("can{channel}"))
}

/// Error in a recording.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, {kind}")]
pub struct RecordingError {
    /// Line, from 1; of a binary format the number of the block or object.
    pub line: usize,
    /// Kind of error.
    pub kind: RecordingErrorKind,
}

/// A line that cannot be read and is left out.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{error}: {text}")]
pub struct SkippedLine {
    /// Line and reason.
    pub error: RecordingError,
    /// The line; a long one is cut.
    pub text: String,
}

/// Kind of error in a recording.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingErrorKind {
    /// The line belongs to no format.
    #[error(
        "format not recognized; allowed: candump log, candump screen, Vector ASC and BLF, PEAK TRC, pcapng and \
         pcap of SocketCAN; `ecan replay --format` selects one of text"
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
    /// A block or object of a binary format that cannot be read; the rest of the file is lost.
    #[error("{0}; the rest of the file cannot be read")]
    Broken(String),
    /// A TRC file of version 2 without `$COLUMNS`.
    #[error("no line ;$COLUMNS before the first frame, which version 2 of TRC needs")]
    NoColumns,
}

/// Frame of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoggedFrame {
    /// Line in the file, from 1; of a binary format the number of the block or object.
    pub line: usize,
    /// Time in nanoseconds, from any reference.
    pub time_ns: u64,
    /// Interface name; `can0` for channel 1 of ASC and BLF, and bus 1 of TRC.
    pub interface: String,
    /// CAN frame.
    pub frame: CanFrame,
}

/// Settings for text that does not state them; `None` is recognized.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Format.
    pub format: Option<Format>,
    /// Reference of the time stamps on candump's screen.
    pub screen_times: Option<ScreenTimes>,
}

/// Contents of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recording {
    /// Given or recognized format.
    pub format: Format,
    /// Frames in the order of the file.
    pub frames: Vec<LoggedFrame>,
    /// Number of error frames and SocketCAN error messages, which are not CAN frames.
    pub error_frames: usize,
    /// Number of other lines or objects without a frame: events of ASC, TRC and BLF.
    pub events: usize,
    /// Number of frames that the recording program has lost, by the recording itself.
    pub dropped: u64,
    /// Lines that cannot be read.
    pub skipped: Vec<SkippedLine>,
    /// Given or recognized reference of the time stamps on candump's screen; `None` in other formats
    /// and without time stamps.
    pub screen_times: Option<ScreenTimes>,
}

impl Recording {
    pub(crate) const fn new(format: Format) -> Self {
        Self {
            format,
            frames: Vec::new(),
            error_frames: 0,
            events: 0,
            dropped: 0,
            skipped: Vec::new(),
            screen_times: None,
        }
    }

    /// The recording, if every line of it could be read.
    ///
    /// # Errors
    /// The first line that could not.
    pub fn whole(mut self) -> Result<Self, RecordingError> {
        if self.skipped.is_empty() { Ok(self) } else { Err(self.skipped.swap_remove(0).error) }
    }

    /// Reads the lines of a text.
    pub(crate) fn of_lines(
        format: Format,
        text: &str,
        mut read: impl FnMut(&str) -> FieldResult<Item>,
    ) -> Self {
        let items = (1..).zip(text.lines()).map(|(line, text)| (line, read(text), text));
        Self::of_items(format, items)
    }

    /// Collects items with their numbers and texts. Times before 0 shift all.
    pub(crate) fn of_items<'t>(
        format: Format,
        items: impl Iterator<Item = (usize, FieldResult<Item>, &'t str)>,
    ) -> Self {
        let mut recording = Self::new(format);
        let mut times = Vec::new();
        for (line, item, text) in items {
            match item {
                Ok(Item::Frame { time_ns, interface, frame }) => {
                    times.push(time_ns);
                    let time_ns = 0;
                    recording.frames.push(LoggedFrame { line, time_ns, interface, frame });
                }
                Ok(Item::ErrorFrame) => recording.error_frames += 1,
                Ok(Item::Event) => recording.events += 1,
                Ok(Item::Dropped(frames)) => {
                    recording.dropped = recording.dropped.saturating_add(frames);
                }
                Ok(Item::Nothing) => {}
                Err(kind) => {
                    let error = RecordingError { line, kind };
                    recording.skipped.push(SkippedLine { error, text: quoted(text.trim()) });
                }
            }
        }
        let origin = times.iter().copied().min().unwrap_or(0).min(0);
        for (frame, time_ns) in recording.frames.iter_mut().zip(times) {
            frame.time_ns = time_ns.abs_diff(origin);
        }
        recording
    }
}

/// Content of a line or object.
#[derive(Clone, Debug)]
pub enum Item {
    Frame {
        time_ns: i64,
        interface: String,
        frame: CanFrame,
    },
    ErrorFrame,
    Event,
    /// Frames that were lost before.
    Dropped(u64),
    Nothing,
}

/// A time that fits 63 bits.
pub fn signed(time_ns: u64) -> FieldResult<i64> {
    i64::try_from(time_ns).map_err(|_| RecordingErrorKind::TimeRange)
}

/// Format of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format {
    /// Log of candump (`candump -l`, `-L`).
    CandumpLog,
    /// Screen of candump, with or without time stamps.
    CandumpScreen,
    /// Vector ASC.
    Asc,
    /// PEAK TRC, versions 1.0 to 2.1.
    Trc,
    /// Vector BLF.
    Blf,
    /// pcapng or pcap with frames of SocketCAN.
    Pcap,
}

impl Format {
    /// The formats of text. Binary ones are always recognized.
    pub const TEXT: [Self; 4] = [Self::CandumpLog, Self::CandumpScreen, Self::Asc, Self::Trc];

    /// Name of the format, as [`FromStr`] accepts it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::CandumpLog => "log",
            Self::CandumpScreen => "screen",
            Self::Asc => "asc",
            Self::Trc => "trc",
            Self::Blf => "blf",
            Self::Pcap => "pcap",
        }
    }

    /// Recognizes the format by the first line that is neither blank nor a comment of candump. A text
    /// without such a line counts as a log of candump.
    ///
    /// # Errors
    /// The line, from 1, that belongs to no format.
    pub fn recognize(text: &str) -> Result<Self, usize> {
        let is_content =
            |line: &&str| !line.trim().is_empty() && !line.trim_start().starts_with('#');
        let content = (1..).zip(text.lines()).find(|(_, line)| is_content(line));
        content.map_or(Ok(Self::CandumpLog), |(number, line)| Self::of_line(line).ok_or(number))
    }

    fn of_line(line: &str) -> Option<Self> {
        let words = line.trim().to_ascii_lowercase();
        let first = words.split_ascii_whitespace().next()?;
        let asc =
            ["date ", "base ", "internal events", "no internal events", "begin trigger", "//"];
        if first.starts_with(';') || first.strip_suffix(')').is_some_and(is_number) {
            return Some(Self::Trc);
        }
        let is_time = first
            .strip_prefix('-')
            .unwrap_or(first)
            .split_once('.')
            .is_some_and(|(a, b)| is_number(a) && is_number(b));
        if is_time || asc.iter().any(|start| words.starts_with(start)) {
            return Some(Self::Asc);
        }
        let is_message = |kind| kind == ParseErrorKind::ErrorMessage;
        match (parse_line(line), parse_screen_line(line)) {
            (Ok(Some(_)), _) => Some(Self::CandumpLog),
            (_, Ok(Some(_))) => Some(Self::CandumpScreen),
            (Err(error), _) if is_message(error.kind) => Some(Self::CandumpLog),
            (_, Err(error)) if is_message(error.kind) => Some(Self::CandumpScreen),
            // The format of a line with an error is needed to describe the error.
            _ if words.contains('#') => Some(Self::CandumpLog),
            _ if words.contains('[') => Some(Self::CandumpScreen),
            _ => None,
        }
    }
}

fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Format {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let found = Self::TEXT.into_iter().find(|format| format.name() == text);
        found.ok_or_else(|| "expected log, screen, asc or trc".to_owned())
    }
}

/// Time stamps above this are times since 1970: 2001 is later, a recording of 30 years is shorter.
const LEAST_ABSOLUTE_NS: u64 = 1_000_000_000 * 1_000_000_000;
/// Share of decreasing time stamps from which they are differences: one in this number.
const DECREASING: usize = 10;

/// Reference of the time stamps on candump's screen, which the text does not state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ScreenTimes {
    /// Since 1970 (`candump -t a`).
    Absolute,
    /// Since the first frame (`candump -t z`).
    SinceFirst,
    /// Since the frame before (`candump -t d`).
    SincePrevious,
}

impl ScreenTimes {
    /// Decides by the time stamps in nanoseconds. The first one is absolute if it is in this century.
    /// Otherwise all are differences if one in ten is smaller than the one before it: times since the
    /// first frame decrease seldom. A few frames, or differences that only grow, count as times since
    /// the first frame.
    #[must_use]
    pub fn recognize(times_ns: &[u64]) -> Self {
        if times_ns.first().is_some_and(|first| *first >= LEAST_ABSOLUTE_NS) {
            return Self::Absolute;
        }
        let decreasing = times_ns.windows(2).filter(|pair| pair.first() > pair.last()).count();
        match decreasing * DECREASING >= times_ns.len().max(1) {
            true => Self::SincePrevious,
            false => Self::SinceFirst,
        }
    }
}

impl FromStr for ScreenTimes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "a" => Ok(Self::Absolute),
            "z" => Ok(Self::SinceFirst),
            "d" => Ok(Self::SincePrevious),
            _ => Err("expected a (since 1970), z (since the first frame) or d (delta)".to_owned()),
        }
    }
}

pub fn parse_log(text: &str) -> Recording {
    Recording::of_lines(Format::CandumpLog, text, |text| {
        let Some(record) = (match frame_or_item(parse_line(text), text)? {
            Ok(record) => record,
            Err(item) => return Ok(item),
        }) else {
            return Ok(Item::Nothing);
        };
        let (time_ns, interface) = (signed(record.time_ns)?, record.interface.to_owned());
        Ok(Item::Frame { time_ns, interface, frame: record.frame })
    })
}

pub fn parse_screen(text: &str, screen_times: Option<ScreenTimes>) -> Recording {
    let (mut has_dates, mut has_times) = (false, false);
    let mut recording = Recording::of_lines(Format::CandumpScreen, text, |text| {
        let Some(record) = (match frame_or_item(parse_screen_line(text), text)? {
            Ok(record) => record,
            Err(item) => return Ok(item),
        }) else {
            return Ok(Item::Nothing);
        };
        let time_ns = match record.time {
            // All frames at once: the text has no times.
            None => 0,
            Some(ScreenTime::Nanoseconds(time_ns)) => {
                has_times = true;
                time_ns
            }
            Some(ScreenTime::Date(date)) => {
                has_dates = true;
                date_ns(date).ok_or_else(|| RecordingErrorKind::Date(date.to_owned()))?
            }
        };
        let (time_ns, interface) = (signed(time_ns)?, record.interface.to_owned());
        Ok(Item::Frame { time_ns, interface, frame: record.frame })
    });
    if has_times && !has_dates {
        let times: Vec<_> = recording.frames.iter().map(|frame| frame.time_ns).collect();
        let reference = screen_times.unwrap_or_else(|| ScreenTimes::recognize(&times));
        recording.screen_times = Some(reference);
        if reference == ScreenTimes::SincePrevious {
            let mut sum_ns = 0_u64;
            for LoggedFrame { time_ns, .. } in &mut recording.frames {
                sum_ns = sum_ns.saturating_add(*time_ns);
                *time_ns = sum_ns;
            }
        }
    }
    recording
}

/// The record of a line of candump, or what the line has in its place: an error message, which concerns the recording
/// interface and is not a frame on the bus, or a number of lost frames.
fn frame_or_item<T>(parsed: Result<T, ParseError>, line: &str) -> FieldResult<Result<T, Item>> {
    match parsed {
        Ok(record) => Ok(Ok(record)),
        Err(error) if error.kind == ParseErrorKind::ErrorMessage => Ok(Err(Item::ErrorFrame)),
        Err(error) => match dropped(line) {
            Some(frames) => Ok(Err(Item::Dropped(frames))),
            None => Err(error.into()),
        },
    }
}

/// The number of `DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 3)`.
fn dropped(line: &str) -> Option<u64> {
    let rest = line.trim_start().strip_prefix("DROPCOUNT: dropped ")?;
    rest.split(' ').next()?.parse().ok()
}

/// The time zone is not in the text and has no effect on differences.
fn date_ns(date: &str) -> Option<u64> {
    let date: DateTime = date.parse().ok()?;
    let time = date.to_zoned(TimeZone::UTC).ok()?.timestamp();
    u64::try_from(time.as_nanosecond()).ok()
}
