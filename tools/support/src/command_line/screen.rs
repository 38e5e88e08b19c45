//! Standard output and standard error of every program, without control characters of other origin.
//!
//! Names of devices, clients, files and keys come from outside and may contain escape sequences. Every
//! program prints through this file, which escapes control characters of all text; `tools/clippy.toml`
//! rejects other ways to print. A sequence of the program itself ([`Sequence`]) is marked with a number
//! that is drawn at start, so that no text from outside can imitate it.

#![allow(clippy::disallowed_methods)] // Here, and only here, the streams are used.

use std::fmt::Display;
use std::hash::{BuildHasher, RandomState};
use std::io::{IsTerminal, Write};
use std::sync::LazyLock;
use std::{fmt, io, process};

use clap::error::ContextValue;
use ecan_protocol::text::{Printable, is_control, write_escaped};

/// Stream of the process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    /// Standard output.
    Output,
    /// Standard error.
    Error,
}

impl Stream {
    /// Returns whether the stream is a terminal.
    pub fn is_terminal(self) -> bool {
        match self {
            Self::Output => io::stdout().is_terminal(),
            Self::Error => io::stderr().is_terminal(),
        }
    }

    /// Returns a writer that changes nothing: for data that another program reads.
    pub fn unfiltered(self) -> Box<dyn Write + Send> {
        match self {
            Self::Output => Box::new(io::stdout()),
            Self::Error => Box::new(io::stderr()),
        }
    }

    fn write_all(self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Output => io::stdout().write_all(bytes),
            Self::Error => io::stderr().write_all(bytes),
        }
    }

    fn flush(self) -> io::Result<()> {
        match self {
            Self::Output => io::stdout().flush(),
            Self::Error => io::stderr().flush(),
        }
    }
}

/// Form of what a [`CleanWriter`] prints, which decides how control characters are escaped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// Text for people: escapes as of [`write_escaped`]. Line breaks and tabulators stay.
    Text,
    /// JSON: escapes as `\u001b`, which keep the document valid and its strings unchanged.
    Json,
    /// Log of `tracing`, which escapes the escape character itself: its colours stay.
    Log,
}

/// Control sequence of the program itself. `Display` writes its mark, which [`CleanWriter`] replaces by the
/// sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sequence {
    /// Green text.
    Green,
    /// Yellow text.
    Yellow,
    /// Red text.
    Red,
    /// Faint text.
    Faint,
    /// End of a colour.
    Reset,
    /// Start of the line, and its removal.
    ClearLine,
}

impl Sequence {
    const ALL: [(Self, char, &'static str); 6] = [
        (Self::Green, 'g', "\x1b[32m"),
        (Self::Yellow, 'y', "\x1b[33m"),
        (Self::Red, 'r', "\x1b[31m"),
        (Self::Faint, 'f', "\x1b[2m"),
        (Self::Reset, 'n', "\x1b[0m"),
        (Self::ClearLine, 'c', "\r\x1b[K"),
    ];

    /// The sequence of the mark at the start of `text`, and the text after the mark.
    fn split_first(text: &str) -> Option<(&'static str, &str)> {
        let mut rest = text.strip_prefix(MARK.as_str())?.chars();
        let code = rest.next()?;
        let (.., sequence) = Self::ALL.iter().find(|(_, letter, _)| *letter == code)?;
        Some((sequence, rest.as_str()))
    }
}

impl Display for Sequence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (_, code, _) =
            Self::ALL.iter().find(|(sequence, ..)| sequence == self).ok_or(fmt::Error)?;
        write!(f, "{}{code}", MARK.as_str())
    }
}

/// Start of the mark of an own sequence.
static MARK: LazyLock<String> =
    LazyLock::new(|| format!("\x1b{:016x}", RandomState::new().hash_one(process::id())));

/// Returns the number of characters that a terminal shows; an own sequence has none.
pub fn width(text: &str) -> usize {
    let mut count = 0;
    let mut rest = text;
    while let Some(character) = rest.chars().next() {
        rest = match Sequence::split_first(rest) {
            Some((_, after)) => after,
            None => {
                count += 1;
                &rest[character.len_utf8()..]
            }
        };
    }
    count
}

/// Writer of a stream. Complete lines are written at once; a line without end is written with `flush` or
/// when the writer is dropped.
#[derive(Debug)]
pub struct CleanWriter {
    stream: Stream,
    content: Content,
    pending: Vec<u8>,
}

impl CleanWriter {
    /// Returns a writer of text for people.
    pub fn new(stream: Stream) -> Self {
        Self::with_content(stream, Content::Text)
    }

    /// As [`new`](Self::new), for another form of content.
    pub fn with_content(stream: Stream, content: Content) -> Self {
        Self { stream, content, pending: Vec::new() }
    }

    fn write_pending(&mut self, count: usize) -> io::Result<()> {
        let bytes: Vec<u8> = self.pending.drain(..count).collect();
        self.stream.write_all(escape(&String::from_utf8_lossy(&bytes), self.content).as_bytes())
    }
}

impl Write for CleanWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.pending.extend_from_slice(bytes);
        if let Some(end) = bytes.iter().rposition(|&byte| byte == b'\n') {
            self.write_pending(self.pending.len() - bytes.len() + end + 1)?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.write_pending(self.pending.len())?;
        self.stream.flush()
    }
}

impl Drop for CleanWriter {
    fn drop(&mut self) {
        // A closed reader is not an error here: who needs the result calls `flush`.
        let _ = self.flush();
    }
}

fn escape(text: &str, content: Content) -> String {
    let mut escaped = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((at, control)) =
        rest.char_indices().find(|&(_, c)| is_control(c) && c != '\n' && c != '\t')
    {
        escaped.push_str(&rest[..at]);
        rest = &rest[at..];
        if let Some((sequence, after)) = Sequence::split_first(rest) {
            escaped.push_str(sequence);
            rest = after;
            continue;
        }
        if let (Content::Log, Some(length)) = (content, color_length(rest)) {
            escaped.push_str(&rest[..length]);
            rest = &rest[length..];
            continue;
        }
        rest = &rest[control.len_utf8()..];
        if content == Content::Json {
            let units = &mut [0; 2];
            let units = control.encode_utf16(units).iter();
            escaped.extend(units.map(|unit| format!("\\u{unit:04x}")));
        } else {
            // Writing to a String cannot fail.
            let _ = write_escaped(&mut escaped, control);
        }
    }
    escaped.push_str(rest);
    escaped
}

/// Length of the colour sequence at the start of `text`.
fn color_length(text: &str) -> Option<usize> {
    let parameters = text.strip_prefix("\x1b[")?;
    let end = parameters.find(|c: char| !c.is_ascii_digit() && c != ';')?;
    parameters[end..].starts_with('m').then_some("\x1b[".len() + end + 1)
}

/// Prints on a stream and flushes it. A closed or full stream is not an error.
pub fn print(stream: Stream, text: impl Display) {
    let mut screen = CleanWriter::new(stream);
    let _ = write!(screen, "{text}").and_then(|()| screen.flush());
}

/// Width of a terminal that does not state its own.
const USUAL_WIDTH: usize = 80;

/// Prints lines on standard error. On a terminal, longer lines are broken between words; a command, a name or a
/// path stays whole. Other readers get each line as it is.
pub fn print_note(text: impl Display) {
    if !Stream::Error.is_terminal() {
        return print(Stream::Error, format_args!("{text}\n"));
    }
    let size = rustix::termios::tcgetwinsize(io::stderr());
    let columns = size.map_or(0, |size| usize::from(size.ws_col));
    let columns = if columns == 0 { USUAL_WIDTH } else { columns };
    print(Stream::Error, format_args!("{}\n", wrap(&text.to_string(), columns)));
}

/// Breaks long lines before words; the rest of a line is indented by two columns more than its start.
fn wrap(text: &str, columns: usize) -> String {
    let mut wrapped = String::with_capacity(text.len());
    for (number, line) in text.split('\n').enumerate() {
        if number > 0 {
            wrapped.push('\n');
        }
        let indent = line.len() - line.trim_start_matches(' ').len();
        let (mut rest, mut used) = (line, 0);
        while !rest.is_empty() {
            let (gap, after) = rest.split_at(rest.len() - rest.trim_start_matches(' ').len());
            let (unit, after) = after.split_at(unit_length(after));
            if used > indent && used + gap.len() + width(unit) > columns {
                wrapped.push('\n');
                wrapped.extend(std::iter::repeat_n(' ', indent + 2));
                used = indent + 2;
            } else {
                wrapped.push_str(gap);
                used += gap.len();
            }
            wrapped.push_str(unit);
            used += width(unit);
            rest = after;
        }
    }
    wrapped
}

/// Length of the text that is not broken: up to the next space outside quotation marks.
fn unit_length(text: &str) -> usize {
    let mut length = 0;
    while let Some(character) = text[length..].chars().next().filter(|c| *c != ' ') {
        let inner = length + character.len_utf8();
        // An apostrophe inside a word is no quotation mark.
        let opens = match character {
            '`' | '"' => true,
            '\'' => !text[..length].ends_with(char::is_alphanumeric),
            _ => false,
        };
        let end = text[inner..].find(character).filter(|_| opens);
        length = end.map_or(inner, |end| inner + end + character.len_utf8());
    }
    length
}

/// As `println!`, through the [`screen`](crate::command_line::screen).
#[macro_export]
macro_rules! print_line {
    ($($text:tt)*) => {
        $crate::command_line::screen::print(
            $crate::command_line::screen::Stream::Output,
            format_args!("{}\n", format_args!($($text)*)),
        )
    };
}

/// As `eprintln!`, through [`print_note`](crate::command_line::screen::print_note).
#[macro_export]
macro_rules! print_error_line {
    ($($text:tt)*) => {
        $crate::command_line::screen::print_note(format_args!($($text)*))
    };
}

/// Parses the arguments of the process. After a wrong argument or a help, prints the message and exits.
pub fn parse_arguments<T: clap::Parser>() -> T {
    T::try_parse().unwrap_or_else(|error| {
        process::exit(print_message(&with_printable_arguments(error)).into())
    })
}

/// Prints the message or the help of clap; returns its exit status.
pub fn print_message(error: &clap::Error) -> u8 {
    if error.use_stderr() {
        print_note(error.render().to_string().trim_end());
    } else {
        // A help has no text from outside. A closed stream is not an error.
        let _ = error.print();
    }
    u8::try_from(error.exit_code()).unwrap_or(u8::MAX)
}

/// Escapes the control characters of the arguments in a message of clap, which would remove escape
/// sequences and print line breaks.
pub fn with_printable_arguments(mut error: clap::Error) -> clap::Error {
    let context: Vec<_> = error.context().map(|(kind, value)| (kind, value.clone())).collect();
    for (kind, value) in context {
        if let ContextValue::String(text) = value {
            error.insert(kind, ContextValue::String(Printable(text).to_string()));
        }
    }
    error
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOSTILE: &str = "a\x1b[2Jb\u{9b}1mc\u{202e}d\x07\r\x7f";

    #[test]
    fn controls_of_text_are_escaped() {
        let text = escape(&format!("{HOSTILE}\n\té\u{1b}[31m"), Content::Text);
        assert_eq!(text, "a\\x1b[2Jb\\x9b1mc\\u{202e}d\\x07\\r\\x7f\n\té\\x1b[31m");
    }

    #[test]
    fn only_marked_sequences_of_the_program_stay() {
        let own = format!("{}{HOSTILE}{}{}", Sequence::Red, Sequence::Reset, Sequence::ClearLine);
        let text = escape(&own, Content::Text);
        assert!(
            text.starts_with("\x1b[31ma\\x1b[2J") && text.ends_with("\x1b[0m\r\x1b[K"),
            "{text:?}"
        );
        let guessed = escape("\x1b0000000000000000r", Content::Text);
        assert_eq!(guessed, "\\x1b0000000000000000r");
        // A mark that was cut is not a sequence.
        let cut = &Sequence::Red.to_string()[..8];
        assert!(escape(cut, Content::Text).starts_with("\\x1b"));
        assert_eq!(width(&format!("{}four{}", Sequence::Red, Sequence::Reset)), 4);
    }

    #[test]
    fn escaped_json_is_valid_and_lossless() {
        let hostile = format!("{HOSTILE}\u{e0041}\n");
        let document = format!("{{\n  \"name\": {:?}\n}}\n", "x").replace("\"x\"", &json(&hostile));
        let escaped = escape(&document, Content::Json);
        assert!(!escaped.chars().any(|c| is_control(c) && c != '\n'), "{escaped:?}");
        let value: serde_json::Value = serde_json::from_str(&escaped).unwrap();
        assert_eq!(value["name"], hostile.as_str());
    }

    #[test]
    fn long_lines_are_broken_between_words_only() {
        let message = "ecan: a name that isn't \"at hand\"; run `ecan sdo read 0x1018:1` or\nshort";
        let lines = [
            "ecan: a name that isn't",
            "  \"at hand\"; run",
            "  `ecan sdo read 0x1018:1`",
            "  or",
            "short",
        ];
        assert_eq!(wrap(message, 24), lines.join("\n"));
        assert_eq!(wrap(message, 200), message);
        assert_eq!(wrap("  tip: one two", 11), "  tip: one\n    two");
        // A unit that is longer than a line is left to the terminal.
        assert_eq!(wrap("a /long/path/of/a/file b", 8), "a\n  /long/path/of/a/file\n  b");
        let red = format!("{}four{} five", Sequence::Red, Sequence::Reset);
        assert_eq!(wrap(&red, 9), red);
    }

    fn json(text: &str) -> String {
        serde_json::to_string(text).unwrap()
    }

    #[test]
    fn log_keeps_colours_only() {
        let text = escape("\x1b[2mtime\x1b[0m name\x1b[2J\x1b[1;31m", Content::Log);
        assert_eq!(text, "\x1b[2mtime\x1b[0m name\\x1b[2J\x1b[1;31m");
    }

    #[test]
    fn incomplete_line_is_written_with_the_rest_of_its_characters() {
        let mut screen = CleanWriter::new(Stream::Error);
        screen.write_all(&"é".as_bytes()[..1]).unwrap();
        assert_eq!(screen.pending, [0xC3]);
        screen.write_all(&[0xA9, b'\n', b'x']).unwrap();
        assert_eq!(screen.pending, b"x");
        screen.pending.clear();
    }
}
