//! Faults of a file, with their locations.

use std::fmt;
use std::path::PathBuf;

use ecan_protocol::text::Printable;
use thiserror::Error;

/// A fault of a configuration file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileFault {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Text of the fault.
    pub reason: String,
}

impl fmt::Display for FileFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}, column {}: {}", self.line, self.column, self.reason)
    }
}

/// Every fault of the text of a configuration, in the order of its lines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileFaults(pub Vec<FileFault>);

impl fmt::Display for FileFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.as_slice() {
            [one] => write!(f, "{one}"),
            all => {
                write!(f, "{} faults", all.len())?;
                all.iter().try_for_each(|fault| write!(f, "\n  - {fault}"))
            }
        }
    }
}

impl std::error::Error for FileFaults {}

/// Error: a configuration file cannot be used.
#[derive(Debug, Error)]
pub enum ConfigFileError {
    /// The file cannot be read.
    #[error("cannot read {}: {reason}", Printable(path.display()))]
    Read {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: std::io::Error,
    },
    /// The file has faults.
    #[error("{}: {faults}", Printable(path.display()))]
    Faults {
        /// The file.
        path: PathBuf,
        /// The faults.
        faults: FileFaults,
    },
}

/// A value with its location.
#[derive(Clone, Debug)]
pub(crate) struct Located<T> {
    pub(crate) value: T,
    /// Offset in bytes.
    pub(crate) at: usize,
}

impl<T> Located<T> {
    pub(crate) fn new(value: T, at: usize) -> Self {
        Self { value, at }
    }
}

/// A text with the starts of its lines.
pub(crate) struct TextLines<'t> {
    text: &'t str,
    /// In bytes.
    starts: Vec<usize>,
}

impl<'t> TextLines<'t> {
    pub(crate) fn new(text: &'t str) -> Self {
        let after = text.match_indices('\n').map(|(at, _)| at + 1);
        Self { text, starts: std::iter::once(0).chain(after).collect() }
    }

    /// Line and column of an offset in bytes; both from 1, the column in characters.
    pub(crate) fn line_and_column(&self, at: usize) -> (usize, usize) {
        let at = at.min(self.text.len());
        let line = self.starts.partition_point(|start| *start <= at);
        let start = line.checked_sub(1).and_then(|line| self.starts.get(line)).copied();
        let before = self.text.get(start.unwrap_or(0)..at).unwrap_or_default();
        (line, before.chars().count() + 1)
    }

    /// Offset in bytes of a line, from 1, and a column, in characters from 0.
    pub(crate) fn offset(&self, line: usize, column: usize) -> usize {
        let start = self.starts.get(line.saturating_sub(1)).copied().unwrap_or(self.text.len());
        let rest = self.text.get(start..).unwrap_or_default();
        start + rest.chars().take(column).map(char::len_utf8).sum::<usize>()
    }

    /// Returns faults by their offsets in the order of the lines.
    ///
    /// # Errors
    /// The faults, if there are any.
    pub(crate) fn finish(&self, mut faults: Vec<(usize, String)>) -> Result<(), FileFaults> {
        faults.sort();
        faults.dedup();
        let located = |(at, reason)| {
            let (line, column) = self.line_and_column(at);
            FileFault { line, column, reason }
        };
        let faults: Vec<_> = faults.into_iter().map(located).collect();
        if faults.is_empty() { Ok(()) } else { Err(FileFaults(faults)) }
    }
}

#[cfg(test)]
mod tests {
    use super::TextLines;

    #[test]
    fn offsets_and_lines_belong_together() {
        let text = TextLines::new("a\nüb\n\nc");
        for (at, place) in [(0, (1, 1)), (2, (2, 1)), (4, (2, 2)), (6, (3, 1)), (7, (4, 1))] {
            assert_eq!(text.line_and_column(at), place, "{at}");
            assert_eq!(text.offset(place.0, place.1 - 1), at, "{place:?}");
        }
        assert_eq!(text.line_and_column(99), (4, 2));
        assert_eq!(text.offset(99, 0), 8);
    }
}
