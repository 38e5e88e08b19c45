//! A TOML document that is read key by key. Every fault is kept with its location, and each key that is not
//! read is a fault.

mod table;
mod values;

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

pub(crate) use table::{Form, Recorder, Table};
use toml::Spanned;
use toml::de::DeTable;
pub(crate) use values::store;

use super::fault::{ConfigFileError, FileFaults, TextLines};

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

/// Reads a file and parses its bytes.
pub(crate) fn load_by<T>(
    path: &Path,
    parse: impl FnOnce(&[u8]) -> Result<T, FileFaults>,
) -> Result<T, ConfigFileError> {
    let bytes = read_bytes(path)
        .map_err(|reason| ConfigFileError::Read { path: path.to_owned(), reason })?;
    parse(&bytes).map_err(|faults| ConfigFileError::Faults { path: path.to_owned(), faults })
}
