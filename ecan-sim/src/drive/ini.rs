//! Syntax of an EDS: sections of `key=value` lines.

use super::eds_error::{EdsError, EdsErrorKind};

/// A parsed file. Names and keys are not case-sensitive.
#[derive(Debug)]
pub(super) struct Ini<'a> {
    sections: Vec<Section<'a>>,
}

#[derive(Debug)]
pub(super) struct Section<'a> {
    pub(super) name: &'a str,
    /// Line, from 1.
    pub(super) line: usize,
    entries: Vec<Entry<'a>>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Entry<'a> {
    pub(super) key: &'a str,
    pub(super) value: &'a str,
    /// Line, from 1.
    pub(super) line: usize,
}

impl<'a> Ini<'a> {
    /// Parses a whole text. Lines that begin with `;` or `#` are comments.
    ///
    /// # Errors
    /// The first line that is invalid or repeats a section or key.
    pub(super) fn parse(text: &'a str) -> Result<Self, EdsError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut sections: Vec<Section<'a>> = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let line_number = number + 1;
            let fail = |kind| Err(EdsError { line: line_number, kind });
            let line = line.trim();
            if line.is_empty() || line.starts_with([';', '#']) {
                continue;
            }
            if let Some(rest) = line.strip_prefix('[') {
                let Some(name) = rest.strip_suffix(']').map(str::trim) else {
                    return fail(EdsErrorKind::UnclosedSection);
                };
                if let Some(first) = find(&sections, name) {
                    return fail(EdsErrorKind::DuplicateSection {
                        name: name.to_owned(),
                        first: first.line,
                    });
                }
                sections.push(Section { name, line: line_number, entries: Vec::new() });
                continue;
            }
            let Some((key, value)) = line.split_once('=') else {
                return fail(EdsErrorKind::InvalidLine);
            };
            let entry = Entry { key: key.trim(), value: value.trim(), line: line_number };
            let Some(section) = sections.last_mut() else {
                return fail(EdsErrorKind::EntryOutsideSection);
            };
            if let Some(first) = section.entry(entry.key) {
                return fail(EdsErrorKind::DuplicateKey {
                    key: entry.key.to_owned(),
                    first: first.line,
                });
            }
            section.entries.push(entry);
        }
        Ok(Self { sections })
    }

    pub(super) fn section(&self, name: &str) -> Option<&Section<'a>> {
        find(&self.sections, name)
    }

    pub(super) fn sections(&self) -> impl Iterator<Item = &Section<'a>> {
        self.sections.iter()
    }
}

fn find<'s, 'a>(sections: &'s [Section<'a>], name: &str) -> Option<&'s Section<'a>> {
    sections.iter().find(|section| section.name.eq_ignore_ascii_case(name))
}

impl<'a> Section<'a> {
    pub(super) fn entry(&self, key: &str) -> Option<Entry<'a>> {
        self.entries.iter().find(|entry| entry.key.eq_ignore_ascii_case(key)).copied()
    }

    /// An entry with a value.
    pub(super) fn filled(&self, key: &str) -> Option<Entry<'a>> {
        self.entry(key).filter(|entry| !entry.value.is_empty())
    }
}
