//! Text of a device file while it is written.

use alloc::string::String;
use core::fmt::{Display, Write as _};

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
