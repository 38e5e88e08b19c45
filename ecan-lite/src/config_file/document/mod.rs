//! A TOML document that is read key by key. Every fault is kept with its location, and each key that is not
//! read is a fault.

use super::schema::Recorder;
use ecan_protocol::text::Printable;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::{fmt, io};
pub(crate) use table::Table;
use thiserror::Error;
use toml::Spanned;
use toml::de::DeTable;
pub(crate) use values::store;

mod table;
mod values;

/// Files that a text may include, by their names in it.
#[derive(Clone, Debug, Default)]
pub(crate) enum Includes {
    #[default]
    None,
    /// The names are relative to a directory.
    Directory(PathBuf),
    Texts(BTreeMap<String, String>),
}

/// Faults and locations of a text.
pub(crate) struct Document<'i> {
    text: TextLines<'i>,
    includes: Includes,
    faults: RefCell<Vec<(usize, String)>>,
    /// Start of the value of each key, by its full path.
    locations: RefCell<BTreeMap<String, usize>>,
    /// Paths with a known fault.
    faulty: RefCell<Vec<String>>,
    syntax_lines: BTreeSet<usize>,
    /// Notes the keys that are asked for: the text is empty then.
    recorder: Option<Recorder>,
}

impl Document<'_> {
    /// Calls the functions that read a file with an empty one, and notes what they ask for.
    pub(crate) fn record(read: impl FnOnce(&Document<'_>, &Spanned<DeTable<'_>>)) -> Recorder {
        let (mut document, root) = Document::parse("");
        document.recorder = Some(Recorder::default());
        read(&document, &root);
        document.recorder.unwrap_or_default()
    }

    /// Reads the bytes of a file with the files that it may include.
    ///
    /// # Errors
    /// Every fault, also of the syntax; bytes that are not UTF-8 do not hide others.
    pub(crate) fn read<T>(
        bytes: &[u8],
        includes: Includes,
        read: impl FnOnce(&Document<'_>, &Spanned<DeTable<'_>>) -> T,
    ) -> Result<T, FileFaults> {
        let mut text = String::with_capacity(bytes.len());
        let mut invalid = Vec::new();
        for chunk in bytes.utf8_chunks() {
            text.push_str(chunk.valid());
            if let Some(byte) = chunk.invalid().first() {
                invalid.push((text.len(), *byte));
                text.push(char::REPLACEMENT_CHARACTER);
            }
        }
        let (mut document, root) = Document::parse(&text);
        document.includes = includes;
        for (at, byte) in invalid {
            document.push(at, format!("byte 0x{byte:02X} is not UTF-8"));
        }
        let content = read(&document, &root);
        document.finish()?;
        Ok(content)
    }
}

impl<'i> Document<'i> {
    /// Parses the text; faults of the syntax do not end it.
    fn parse(text: &'i str) -> (Self, Spanned<DeTable<'i>>) {
        let (root, errors) = DeTable::parse_recoverable(text);
        let mut document = Self {
            text: TextLines::new(text),
            includes: Includes::None,
            faults: RefCell::default(),
            locations: RefCell::default(),
            faulty: RefCell::default(),
            syntax_lines: BTreeSet::new(),
            recorder: None,
        };
        for error in errors {
            let at = error.span().map_or(0, |span| span.start);
            let (line, _) = document.text.line_and_column(at);
            document.syntax_lines.insert(line);
            document.push(at, error.message().trim());
        }
        (document, root)
    }

    /// True if the text has no fault of the syntax.
    pub(crate) fn is_valid_toml(&self) -> bool {
        self.syntax_lines.is_empty()
    }

    /// Reports a fault at a location.
    pub(crate) fn push(&self, at: usize, reason: impl Into<String>) {
        self.faults.borrow_mut().push((at, reason.into()));
    }

    fn locate(&self, path: &str, span: &Range<usize>) {
        self.locations.borrow_mut().insert(path.to_owned(), span.start);
    }

    /// Reports a fault of the value at a path. A consequence of a fault of the syntax in the same line
    /// is not reported.
    fn fault(&self, path: &str, at: usize, reason: impl Into<String>) {
        if let Some(recorder) = &self.recorder {
            // The file is empty: it lacks the key.
            recorder.required(path);
        }
        let (line, _) = self.text.line_and_column(at);
        self.faulty.borrow_mut().push(path.to_owned());
        if !self.syntax_lines.contains(&line) {
            self.push(at, reason);
        }
    }

    /// True if a fault of this path is known.
    fn is_faulty(&self, path: &str) -> bool {
        self.faulty.borrow().iter().any(|faulty| faulty == path)
    }

    /// Reports a fault of the values at the first of these paths that the file has, or at the table
    /// around it. Not reported if a path already has a fault: this one would be its consequence.
    pub(crate) fn semantic_fault(&self, paths: &[String], reason: String) {
        if paths.iter().any(|path| self.is_faulty(path)) {
            return;
        }
        let found = paths.iter().find_map(|path| self.locations.borrow().get(path).copied());
        let around = || paths.first().and_then(|path| self.around(path));
        self.push(found.or_else(around).unwrap_or(0), reason);
    }

    /// The nearest table around a path.
    fn around(&self, path: &str) -> Option<usize> {
        let (outer, _) = path.rsplit_once('.')?;
        self.locations.borrow().get(outer).copied().or_else(|| self.around(outer))
    }

    /// Returns all faults in the order of the lines.
    ///
    /// # Errors
    /// The faults, if there are any.
    fn finish(self) -> Result<(), FileFaults> {
        self.text.finish(self.faults.take())
    }
}

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

/// No configuration is larger; the path may be a device, or a log by mistake.
const MAX_BYTES: u64 = 16 << 20;

/// Standard input: it can be read once, and a configuration is read in parts.
static STANDARD_INPUT: Mutex<Option<Vec<u8>>> = Mutex::new(None);

/// Reads the bytes of a file of at most 16 MiB; `-` is standard input, which is kept for later calls of
/// the process.
///
/// # Errors
/// The file cannot be read or is larger.
pub fn read_bytes(path: impl AsRef<Path>) -> io::Result<Vec<u8>> {
    let path = path.as_ref();
    if path != Path::new("-") {
        return limited(File::open(path)?);
    }
    let mut kept = STANDARD_INPUT.lock().unwrap_or_else(PoisonError::into_inner);
    match &*kept {
        Some(bytes) => Ok(bytes.clone()),
        None => Ok(kept.insert(limited(io::stdin())?).clone()),
    }
}

fn limited(input: impl Read) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    input.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_BYTES {
        let reason = "larger than 16 MiB; not a configuration file";
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, reason));
    }
    Ok(bytes)
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
