//! Formats of recordings.

use core::fmt;
use core::str::FromStr;

use crate::candump::{ParseErrorKind, parse_line, parse_screen_line};

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
