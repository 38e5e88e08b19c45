//! Position in a line.

use crate::candump::error::{ParseError, ParseErrorKind};

/// Read position in a line.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cursor<'a> {
    line: &'a str,
    /// Byte offset, always on a character boundary: only words and ASCII characters are taken.
    offset: usize,
}

impl<'a> Cursor<'a> {
    pub(crate) const fn new(line: &'a str) -> Self {
        Self { line, offset: 0 }
    }

    pub(crate) fn rest(&self) -> &'a str {
        self.line.get(self.offset..).unwrap_or_default()
    }

    pub(crate) fn peek(&self) -> Option<u8> {
        self.line.as_bytes().get(self.offset).copied()
    }

    pub(crate) fn at_end(&self) -> bool {
        self.offset >= self.line.len()
    }

    /// Skips the ASCII character returned by `peek`.
    pub(crate) fn skip(&mut self) {
        self.offset += 1;
    }

    /// Takes the ASCII character `wanted` if it is next.
    pub(crate) fn take(&mut self, wanted: u8) -> bool {
        let found = self.peek() == Some(wanted);
        if found {
            self.skip();
        }
        found
    }

    pub(crate) fn take_blanks(&mut self) -> bool {
        let before = self.offset;
        while self.peek().is_some_and(is_blank) {
            self.skip();
        }
        self.offset > before
    }

    /// Takes everything up to the next blank.
    pub(crate) fn take_word(&mut self) -> &'a str {
        let rest = self.rest();
        let length = rest.bytes().position(is_blank).unwrap_or(rest.len());
        self.offset += length;
        rest.get(..length).unwrap_or_default()
    }

    pub(crate) fn take_decimal(&mut self) -> Option<u8> {
        self.take_digit(10)
    }

    pub(crate) fn take_hex(&mut self) -> Option<u8> {
        self.take_digit(16)
    }

    fn take_digit(&mut self, radix: u32) -> Option<u8> {
        let value = char::from(self.peek()?).to_digit(radix)?;
        self.skip();
        Some(value as u8)
    }

    pub(crate) fn error(&self, kind: ParseErrorKind) -> ParseError {
        let before = self.line.get(..self.offset).unwrap_or(self.line);
        ParseError { kind, column: before.chars().count() + 1 }
    }
}

const fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r' | b'\n')
}
