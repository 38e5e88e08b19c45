//! Reads recordings of CAN buses: logs and screens of candump, Vector ASC, PEAK TRC.
//!
//! [`Recording::parse`] recognizes the format by the first lines. Times count from any reference: only
//! their differences have a meaning. Interfaces are named `can0`, `can1` ...; channel 1 of an ASC file
//! and bus 1 of a TRC file are `can0`. Error frames and other events are counted, not returned.
//!
//! ```
//! use ecan_can_io::recording::{Format, ReadOptions, Recording};
//!
//! let text = "\
//! ;$FILEVERSION=2.0
//! ;$COLUMNS=N,O,T,I,d,l,D
//!       1      1059.900 DT     0300 Rx 2  01 02
//! ";
//! let recording = Recording::parse(text, &ReadOptions::default())?;
//! assert_eq!(recording.format, Format::Trc);
//! assert_eq!(recording.frames[0].time_ns, 1_059_900_000);
//! assert_eq!(recording.frames[0].frame.data(), [1, 2]);
//! # Ok::<(), ecan_can_io::recording::RecordingError>(())
//! ```

use crate::candump::{ParseError, ParseErrorKind, ScreenTime, parse_line, parse_screen_line};
use core::fmt;
use core::str::FromStr;
use ecan_protocol::can::CanFrame;
use jiff::civil::DateTime;
use jiff::tz::TimeZone;

mod asc;
mod fields;
mod trc;

/// Frame of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoggedFrame {
    /// Line in the file, from 1.
    pub line: usize,
    /// Time in nanoseconds, from any reference.
    pub time_ns: u64,
    /// Interface name; `can0` for channel 1 of ASC and bus 1 of TRC.
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
    /// Number of other lines without a frame: events of ASC and TRC.
    pub events: usize,
    /// Given or recognized reference of the time stamps on candump's screen; `None` in other formats
    /// and without time stamps.
    pub screen_times: Option<ScreenTimes>,
}

impl Recording {
    /// Parses a recording.
    ///
    /// # Errors
    /// The first invalid line, or a format that is not recognized.
    pub fn parse(text: &str, options: &ReadOptions) -> Result<Self, RecordingError> {
        // Exports of Windows programs may begin with a byte order mark.
        let text = text.strip_prefix('\u{FEFF}').unwrap_or(text);
        let unknown = |line| RecordingError { line, kind: RecordingErrorKind::UnknownFormat };
        let format = match options.format {
            Some(format) => format,
            None => Format::recognize(text).map_err(unknown)?,
        };
        match format {
            Format::CandumpLog => parse_log(text),
            Format::CandumpScreen => parse_screen(text, options.screen_times),
            Format::Asc => asc::parse(text),
            Format::Trc => trc::parse(text),
        }
    }

    pub(crate) const fn new(format: Format) -> Self {
        Self { format, frames: Vec::new(), error_frames: 0, events: 0, screen_times: None }
    }
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
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 4] = [Self::CandumpLog, Self::CandumpScreen, Self::Asc, Self::Trc];

    /// Name of the format, as [`FromStr`] accepts it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::CandumpLog => "log",
            Self::CandumpScreen => "screen",
            Self::Asc => "asc",
            Self::Trc => "trc",
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
        let is_time = first.split_once('.').is_some_and(|(a, b)| is_number(a) && is_number(b));
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
    !text.is_empty() && text.bytes().all(|it| it.is_ascii_digit())
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Format {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let found = Self::ALL.into_iter().find(|it| it.name() == text);
        found.ok_or_else(|| "expected log, screen, asc or trc".to_owned())
    }
}

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
        let decreasing = times_ns.windows(2).filter(|it| it.first() > it.last()).count();
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

/// `None` for a line without a frame.
type Parsed<T> = Result<Option<T>, RecordingError>;

fn parse_log(text: &str) -> Result<Recording, RecordingError> {
    let mut recording = Recording::new(Format::CandumpLog);
    for (line, text) in (1..).zip(text.lines()) {
        if let Some(record) = counted(line, parse_line(text), &mut recording)? {
            recording.frames.push(LoggedFrame {
                line,
                time_ns: record.time_ns,
                interface: record.interface.to_owned(),
                frame: record.frame,
            });
        }
    }
    Ok(recording)
}

fn parse_screen(
    text: &str,
    screen_times: Option<ScreenTimes>,
) -> Result<Recording, RecordingError> {
    let mut recording = Recording::new(Format::CandumpScreen);
    let (mut has_dates, mut has_times) = (false, false);
    for (line, text) in (1..).zip(text.lines()) {
        let parsed = counted(line, parse_screen_line(text), &mut recording)?;
        let Some(record) = parsed else { continue };
        let time_ns = match record.time {
            // All frames at once: the text has no times.
            None => 0,
            Some(ScreenTime::Nanoseconds(time_ns)) => {
                has_times = true;
                time_ns
            }
            Some(ScreenTime::Date(date)) => {
                has_dates = true;
                let invalid = || RecordingErrorKind::Date(date.to_owned());
                date_ns(date).ok_or_else(|| RecordingError { line, kind: invalid() })?
            }
        };
        let (interface, frame) = (record.interface.to_owned(), record.frame);
        recording.frames.push(LoggedFrame { line, time_ns, interface, frame });
    }
    if has_times && !has_dates {
        let times: Vec<_> = recording.frames.iter().map(|it| it.time_ns).collect();
        let reference = screen_times.unwrap_or_else(|| ScreenTimes::recognize(&times));
        recording.screen_times = Some(reference);
        if reference == ScreenTimes::SincePrevious {
            add_up(&mut recording.frames)?;
        }
    }
    Ok(recording)
}

/// Counts an error message, which concerns the recording interface and is not a frame on the bus.
fn counted<T>(
    line: usize,
    parsed: Result<Option<T>, ParseError>,
    recording: &mut Recording,
) -> Parsed<T> {
    match parsed {
        Err(error) if error.kind == ParseErrorKind::ErrorMessage => {
            recording.error_frames += 1;
            Ok(None)
        }
        parsed => parsed.map_err(|cause| RecordingError { line, kind: cause.into() }),
    }
}

fn add_up(frames: &mut [LoggedFrame]) -> Result<(), RecordingError> {
    let mut sum_ns = 0_u64;
    for LoggedFrame { line, time_ns, .. } in frames {
        let too_late = RecordingError { line: *line, kind: RecordingErrorKind::TimeRange };
        sum_ns = sum_ns.checked_add(*time_ns).ok_or(too_late)?;
        *time_ns = sum_ns;
    }
    Ok(())
}

/// The time zone is not in the text and has no effect on differences.
fn date_ns(date: &str) -> Option<u64> {
    let date: DateTime = date.parse().ok()?;
    let time = date.to_zoned(TimeZone::UTC).ok()?.timestamp();
    u64::try_from(time.as_nanosecond()).ok()
}
