//! Syntax of a device file: sections of `key=value` lines, read and written.

use alloc::borrow::ToOwned as _;
use alloc::collections::BTreeMap;
use alloc::string::{String, ToString as _};
use alloc::vec::Vec;
use core::fmt::{Display, Write as _};

use super::deviation::{FileProblem, Report};

/// A line `key=value`.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub(super) key: String,
    pub(super) value: String,
    /// From 1.
    pub(super) line: usize,
}

/// A section, from which a reader takes the entries that it uses.
#[derive(Clone, Debug)]
pub(super) struct Section {
    pub(super) name: String,
    /// From 1.
    pub(super) line: usize,
    pub(super) entries: Vec<Line>,
}

impl Section {
    /// An empty section, in place of a missing one.
    pub(super) fn empty(name: &str, line: usize) -> Self {
        Self { name: name.to_owned(), line, entries: Vec::new() }
    }

    /// The entry with this key and a value.
    pub(super) fn filled(&self, key: &str) -> Option<&Line> {
        let has_key = |entry: &&Line| entry.key.eq_ignore_ascii_case(key);
        self.entries.iter().find(has_key).filter(|entry| !entry.value.is_empty())
    }

    /// Removes the entry with this key; `None` if it has no value.
    pub(super) fn take(&mut self, key: &str) -> Option<Line> {
        let position = self.entries.iter().position(|entry| entry.key.eq_ignore_ascii_case(key))?;
        Some(self.entries.remove(position)).filter(|entry| !entry.value.is_empty())
    }

    /// Puts an entry back that could not be used, so that it is kept as it is.
    pub(super) fn put_back(&mut self, entry: Line) {
        self.entries.push(entry);
    }

    /// The remaining entries, in the order of their keys.
    pub(super) fn into_rest(mut self) -> Vec<(String, String)> {
        self.entries.sort_by_key(|entry| entry.key.to_ascii_lowercase());
        self.entries.into_iter().map(|entry| (entry.key, entry.value)).collect()
    }

    /// Takes the entries whose keys are a prefix and a decimal number, in the order of the numbers.
    pub(super) fn take_numbered(&mut self, prefix: &str) -> Vec<(u16, Line)> {
        let mut taken = Vec::new();
        self.entries.retain(|entry| {
            let number = numbered(&entry.key, prefix);
            taken.extend(number.map(|number| (number, entry.clone())));
            number.is_none()
        });
        taken.sort_by_key(|(number, _)| *number);
        taken.dedup_by_key(|(number, _)| *number);
        taken
    }
}

/// The number in a name that is a prefix and a decimal number.
pub(super) fn numbered(name: &str, prefix: &str) -> Option<u16> {
    let (start, digits) = name.split_at_checked(prefix.len())?;
    let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    (start.eq_ignore_ascii_case(prefix) && is_number).then(|| digits.parse().ok()).flatten()
}

/// A parsed file. Names and keys are not case-sensitive.
#[derive(Debug, Default)]
pub(super) struct Document {
    sections: Vec<Section>,
    /// Number of lines.
    pub(super) lines: usize,
}

impl Document {
    pub(super) fn parse(bytes: &[u8], report: &mut Report) -> Self {
        let text = decode(bytes, report);
        let text = match text.strip_prefix('\u{feff}') {
            Some(rest) => {
                report.warn(1, FileProblem::ByteOrderMark);
                rest
            }
            None => &text,
        };
        let mut parser = Parser { document: Self::default(), names: BTreeMap::new(), keys: None };
        for (text, line) in split_lines(text, report).into_iter().zip(1..) {
            parser.document.lines = line;
            let text = text.trim();
            if !text.is_empty() && !text.starts_with([';', '#']) {
                parser.add(text, line, report);
            }
        }
        parser.document
    }

    /// Removes the section with this name.
    pub(super) fn take(&mut self, name: &str) -> Option<Section> {
        let has_name = |section: &Section| section.name.eq_ignore_ascii_case(name);
        let position = self.sections.iter().position(has_name)?;
        Some(self.sections.remove(position))
    }

    /// The remaining sections in the order of their lines.
    pub(super) fn into_sections(self) -> Vec<Section> {
        self.sections
    }
}

struct Parser {
    document: Document,
    /// Lines of the sections by their names in lower case.
    names: BTreeMap<String, usize>,
    /// Lines of the keys of the present section; `None` in a section that is ignored.
    keys: Option<BTreeMap<String, usize>>,
}

impl Parser {
    fn add(&mut self, text: &str, line: usize, report: &mut Report) {
        if let Some(rest) = text.strip_prefix('[') {
            return self.begin_section(rest, line, report);
        }
        let Some((key, value)) = text.split_once('=') else {
            return report.warn(line, FileProblem::NotAnEntry);
        };
        let (key, value) = (key.trim().to_owned(), value.trim().to_owned());
        let Some(section) = self.document.sections.last_mut() else {
            return report.warn(line, FileProblem::OutsideSection { key });
        };
        let Some(keys) = &mut self.keys else { return };
        if let Some(first) = keys.get(&key.to_ascii_lowercase()) {
            return report.warn(line, FileProblem::DuplicateKey { key, first: *first });
        }
        keys.insert(key.to_ascii_lowercase(), line);
        section.entries.push(Line { key, value, line });
    }

    fn begin_section(&mut self, rest: &str, line: usize, report: &mut Report) {
        let section = match rest.split_once(']') {
            Some((name, after)) => {
                let section = name.trim().to_owned();
                let after = after.trim();
                if !after.is_empty() && !after.starts_with([';', '#']) {
                    report.warn(line, FileProblem::TextAfterSection { section: section.clone() });
                }
                section
            }
            None => {
                let section = rest.trim().to_owned();
                report.warn(line, FileProblem::OpenSection { section: section.clone() });
                section
            }
        };
        let name = section.to_ascii_lowercase();
        if let Some(first) = self.names.get(&name) {
            self.keys = None;
            return report.warn(line, FileProblem::DuplicateSection { section, first: *first });
        }
        self.names.insert(name, line);
        self.keys = Some(BTreeMap::new());
        self.document.sections.push(Section { name: section, line, entries: Vec::new() });
    }
}

/// Decodes UTF-8, UTF-16 with a byte order mark, or ISO 8859-1.
fn decode(bytes: &[u8], report: &mut Report) -> String {
    let utf_16 = |bytes: &[u8], unit: fn([u8; 2]) -> u16| -> String {
        let units = bytes.as_chunks::<2>().0.iter().map(|pair| unit(*pair));
        char::decode_utf16(units)
            .map(|character| character.unwrap_or(char::REPLACEMENT_CHARACTER))
            .collect()
    };
    let (text, encoding) = match bytes {
        [0xFF, 0xFE, ..] => (utf_16(bytes, u16::from_le_bytes), "UTF-16"),
        [0xFE, 0xFF, ..] => (utf_16(bytes, u16::from_be_bytes), "UTF-16"),
        _ => match core::str::from_utf8(bytes) {
            Ok(text) => (text.to_string(), "UTF-8"),
            Err(_) => (bytes.iter().map(|byte| char::from(*byte)).collect(), "ISO 8859-1"),
        },
    };
    let after_mark = text.strip_prefix('\u{feff}').unwrap_or(&text);
    if let Some(position) = after_mark.find(|character: char| !character.is_ascii()) {
        let line = 1 + after_mark[..position].matches('\n').count();
        report.warn(line, FileProblem::NotAscii { encoding });
    }
    text
}

/// Splits at LF, CR LF and CR.
fn split_lines<'a>(text: &'a str, report: &mut Report) -> Vec<&'a str> {
    let mut lines = Vec::new();
    let mut is_reported = false;
    for line in text.split('\n') {
        let line = line.strip_suffix('\r').unwrap_or(line);
        for (position, part) in line.split('\r').enumerate() {
            if position > 0 && !is_reported {
                report.warn(lines.len(), FileProblem::LoneCarriageReturn);
                is_reported = true;
            }
            lines.push(part);
        }
    }
    lines
}

/// Sections and entries with LF line ends.
#[derive(Debug, Default)]
pub(super) struct Output {
    text: String,
}

impl Output {
    pub(super) fn section(&mut self, name: impl Display) {
        let separator = if self.text.is_empty() { "" } else { "\n" };
        // Writing to a String cannot fail.
        let _ = writeln!(self.text, "{separator}[{name}]");
    }

    /// Adds an entry; a line break in the value becomes a blank.
    pub(super) fn entry(&mut self, key: &str, value: impl Display) {
        let start = self.text.len();
        let _ = write!(self.text, "{key}={value}");
        if self.text[start..].contains(['\n', '\r']) {
            let line = self.text[start..].replace(['\n', '\r'], " ");
            self.text.truncate(start);
            self.text.push_str(&line);
        }
        self.text.push('\n');
    }

    /// Adds an entry unless the value is empty.
    pub(super) fn text(&mut self, key: &str, value: &str) {
        if !value.is_empty() {
            self.entry(key, value);
        }
    }

    pub(super) fn entries(&mut self, entries: &[(String, String)]) {
        for (key, value) in entries {
            self.entry(key, value);
        }
    }

    pub(super) fn finish(self) -> String {
        self.text
    }
}
