//! Texts of candump.

use jiff::civil::DateTime;
use jiff::tz::TimeZone;

use super::records::{
    Format, LoggedFrame, Recording, RecordingError, RecordingErrorKind, ScreenTimes,
};
use crate::candump::{ParseError, ParseErrorKind, ScreenTime, parse_line, parse_screen_line};

/// `None` for a line without a frame.
type Parsed<T> = Result<Option<T>, RecordingError>;

pub fn parse_log(text: &str) -> Result<Recording, RecordingError> {
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

pub fn parse_screen(
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
        let times: Vec<_> = recording.frames.iter().map(|frame| frame.time_ns).collect();
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
