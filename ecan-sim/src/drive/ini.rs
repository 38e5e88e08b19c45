//! Syntax of an EDS: sections of `key=value` lines.

use super::eds_error::EdsError;

/// A parsed file. Names and keys are not case-sensitive.
#[derive(Debug)]
pub(super) struct Ini<'a> {
    pub(super) sections: Vec<Section<'a>>,
}

#[derive(Debug)]
pub(super) struct Section<'a> {
    pub(super) name: &'a str,
    /// From 1.
    pub(super) line: usize,
    entries: Vec<Entry<'a>>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Entry<'a> {
    key: &'a str,
    pub(super) value: &'a str,
    /// From 1.
    pub(super) line: usize,
}

impl<'a> Ini<'a> {
    /// Parses a whole text. Lines that begin with `;` or `#` are comments.
    pub(super) fn parse(text: &'a str) -> Result<Self, EdsError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut ini = Self { sections: Vec::new() };
        for (text, line) in text.lines().map(str::trim).zip(1..) {
            if text.is_empty() || text.starts_with([';', '#']) {
                continue;
            }
            ini.add(text, line).map_err(|reason| EdsError::new(line, reason))?;
        }
        Ok(ini)
    }

    fn add(&mut self, text: &'a str, line: usize) -> Result<(), String> {
        if let Some(rest) = text.strip_prefix('[') {
            let name = rest.strip_suffix(']').ok_or("section name without closing bracket")?.trim();
            if let Some(Section { line, .. }) = self.section(name) {
                return Err(format!("section [{name}] already exists at line {line}"));
            }
            self.sections.push(Section { name, line, entries: Vec::new() });
            return Ok(());
        }
        let (key, value) = text.split_once('=').ok_or("neither [section] nor key=value")?;
        let (key, value) = (key.trim(), value.trim());
        let section = self.sections.last_mut().ok_or("entry outside any section")?;
        if let Some(Entry { line, .. }) = section.entry(key) {
            return Err(format!("`{key}` already exists at line {line}"));
        }
        section.entries.push(Entry { key, value, line });
        Ok(())
    }

    pub(super) fn section(&self, name: &str) -> Option<&Section<'a>> {
        self.sections.iter().find(|section| section.name.eq_ignore_ascii_case(name))
    }
}

impl<'a> Section<'a> {
    fn entry(&self, key: &str) -> Option<Entry<'a>> {
        self.entries.iter().find(|entry| entry.key.eq_ignore_ascii_case(key)).copied()
    }

    /// An entry with a value.
    pub(super) fn filled(&self, key: &str) -> Option<Entry<'a>> {
        self.entry(key).filter(|entry| !entry.value.is_empty())
    }

    pub(super) fn need(&self, key: &str) -> Result<Entry<'a>, EdsError> {
        self.filled(key)
            .ok_or_else(|| EdsError::new(self.line, format!("[{}] has no `{key}`", self.name)))
    }
}

impl Entry<'_> {
    pub(super) fn error(&self, reason: impl Into<String>) -> EdsError {
        EdsError::new(self.line, reason)
    }
}
