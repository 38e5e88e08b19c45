//! Text of other programs and devices in messages.
//!
//! A device name, a client name or a file name may contain control characters: an escape sequence
//! moves the cursor or reprograms a terminal, a line break forges a line, a bidirectional override
//! reorders what a reader sees.

use core::fmt;
use core::fmt::{Display, Write};

/// Returns whether a character changes how a terminal shows the characters around it: C0 and C1
/// controls, line and paragraph separators, bidirectional controls, and invisible format characters.
pub const fn is_control(character: char) -> bool {
    matches!(
        character,
        '\0'..='\x1F'
            | '\x7F'..='\u{9F}'
            | '\u{61C}'
            | '\u{180E}'
            | '\u{200B}'..='\u{200F}'
            | '\u{2028}'..='\u{202E}'
            | '\u{2060}'..='\u{206F}'
            | '\u{FEFF}'
            | '\u{FFF9}'..='\u{FFFB}'
            | '\u{E0000}'..='\u{E007F}'
    )
}

/// Writes a value as text of one line without control characters: those of [`is_control`] are written
/// as escapes, for example `\x1b`, `\n` or `\u{202e}`.
///
/// ```
/// use ecan_protocol::text::Printable;
///
/// assert_eq!(Printable("pump\x1b[2J\n").to_string(), r"pump\x1b[2J\n");
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Printable<T>(pub T);

/// As [`Printable`], for text of several lines: line breaks stay.
#[derive(Debug, Clone, Copy)]
pub struct PrintableLines<T>(pub T);

impl<T: Display> Display for Printable<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(Escaping { out: f, keeps_lines: false }, "{}", self.0)
    }
}

impl<T: Display> Display for PrintableLines<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(Escaping { out: f, keeps_lines: true }, "{}", self.0)
    }
}

/// Writes one character, as an escape if it is a control character.
///
/// # Errors
/// The writer fails.
pub fn write_escaped(out: &mut (impl Write + ?Sized), character: char) -> fmt::Result {
    match character {
        '\n' => out.write_str("\\n"),
        '\r' => out.write_str("\\r"),
        '\t' => out.write_str("\\t"),
        '\0'..='\u{FF}' if is_control(character) => write!(out, "\\x{:02x}", character as u32),
        _ if is_control(character) => write!(out, "\\u{{{:x}}}", character as u32),
        _ => out.write_char(character),
    }
}

struct Escaping<'a, 'b> {
    out: &'a mut fmt::Formatter<'b>,
    keeps_lines: bool,
}

impl Write for Escaping<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let is_escaped =
            |character| is_control(character) && !(self.keeps_lines && character == '\n');
        let mut rest = text;
        while let Some((at, control)) = rest.char_indices().find(|&(_, c)| is_escaped(c)) {
            self.out.write_str(&rest[..at])?;
            write_escaped(self.out, control)?;
            rest = &rest[at + control.len_utf8()..];
        }
        self.out.write_str(rest)
    }
}

/// The known word that a misspelled one may mean: at most two letters have to be added, removed or
/// changed.
///
/// ```
/// use ecan_protocol::text::closest;
///
/// assert_eq!(closest("drive", &["echo", "drives"]), Some("drives"));
/// assert_eq!(closest("motor", &["echo", "drives"]), None);
/// ```
pub fn closest<'k>(word: &str, known: &[&'k str]) -> Option<&'k str> {
    let distances = known.iter().map(|known| (distance(word, known), *known));
    distances.min().filter(|(distance, _)| *distance <= 2).map(|(_, known)| known)
}

/// Longest word that is compared, in letters.
const MAX_WORD: usize = 47;

/// Number of letters to add, remove or change; `usize::MAX` of a longer word.
fn distance(from: &str, to: &str) -> usize {
    let length = to.chars().count();
    let mut row: [usize; MAX_WORD + 1] = core::array::from_fn(|letters| letters);
    if length > MAX_WORD {
        return usize::MAX;
    }
    for (nth, letter) in from.chars().enumerate() {
        let mut diagonal = nth;
        let mut left = nth + 1;
        row[0] = left;
        for (cell, other) in row.iter_mut().skip(1).zip(to.chars()) {
            let changed = diagonal + usize::from(letter != other);
            diagonal = *cell;
            left = changed.min(left + 1).min(*cell + 1);
            *cell = left;
        }
    }
    row.get(length).copied().unwrap_or(usize::MAX)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

    #[test]
    fn controls_are_escaped_and_letters_stay() {
        let text = "a\x1b]0;x\x07b\u{85}c\u{2067}d\u{e0041}\té\u{10ffff}";
        let escaped = r"a\x1b]0;x\x07b\x85c\u{2067}d\u{e0041}\té";
        assert_eq!(Printable(text).to_string(), std::format!("{escaped}\u{10ffff}"));
        assert_eq!(Printable("one\ntwo").to_string(), r"one\ntwo");
        assert_eq!(PrintableLines("one\ntwo\r").to_string(), "one\ntwo\\r");
    }

    #[test]
    fn every_control_of_unicode_is_escaped() {
        for character in (char::MIN..=char::MAX).filter(|character| character.is_control()) {
            assert!(is_control(character), "{character:?}");
        }
    }
}
