//! Statements of a DBC file. One that cannot be read is a fault in its line; the others are used.

use std::borrow::Cow;
use std::ops::RangeInclusive;

use super::faults::FaultKind;
use super::signal::ByteOrder;

/// First words of the statements, with those that have no effect here.
const KEYWORDS: [&str; 29] = [
    "BA_",
    "BA_DEF_",
    "BA_DEF_DEF_",
    "BA_DEF_DEF_REL_",
    "BA_DEF_REL_",
    "BA_DEF_SGTYPE_",
    "BA_REL_",
    "BA_SGTYPE_",
    "BO_",
    "BO_TX_BU_",
    "BS_",
    "BU_",
    "CAT_",
    "CAT_DEF_",
    "CM_",
    "ENVVAR_DATA_",
    "EV_",
    "EV_DATA_",
    "NS_",
    "SGTYPE_",
    "SGTYPE_VAL_",
    "SG_",
    "SG_MUL_VAL_",
    "SIG_GROUP_",
    "SIG_TYPE_REF_",
    "SIG_VALTYPE_",
    "VAL_",
    "VAL_TABLE_",
    "VERSION",
];
/// Longest text of a line in a message.
const MAX_QUOTED: usize = 80;

/// Role of a signal in multiplexing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Multiplexing {
    pub is_multiplexer: bool,
    /// Value of the multiplexer with which the signal is in a frame.
    pub value: Option<u64>,
}

/// Numbers are texts where the format has limits of its own.
#[derive(Clone, Debug, PartialEq)]
pub enum Item<'a> {
    Message {
        id: &'a str,
        name: &'a str,
        length: &'a str,
    },
    /// Signal of the last message.
    Signal {
        name: &'a str,
        multiplexing: Multiplexing,
        start: &'a str,
        bits: &'a str,
        order: ByteOrder,
        is_signed: bool,
        factor: f64,
        offset: f64,
        range: (f64, f64),
        unit: Cow<'a, str>,
    },
    /// Texts of raw values.
    Texts {
        message: &'a str,
        signal: &'a str,
        texts: Vec<(&'a str, Cow<'a, str>)>,
    },
    /// 0 integer, 1 float, 2 double.
    ValueType {
        message: &'a str,
        signal: &'a str,
        kind: &'a str,
    },
    Multiplexer {
        message: &'a str,
        signal: &'a str,
        multiplexer: &'a str,
        values: Vec<RangeInclusive<u64>>,
    },
    /// Values of an attribute of messages of kind ENUM.
    Values {
        attribute: &'a str,
        values: Vec<&'a str>,
    },
    Default {
        attribute: &'a str,
        value: &'a str,
    },
    /// Value of an attribute of a message, or of one of its signals.
    Attribute {
        attribute: &'a str,
        message: &'a str,
        signal: Option<&'a str>,
        value: &'a str,
    },
    /// A message that cannot be read, or a line that may be one: the signals after it belong to none.
    NoMessage,
    /// A statement without effect.
    Other,
}

/// Calls `take` with the line, from 1, of each statement that has an effect, and its content.
pub fn read<'a>(text: &'a str, mut take: impl FnMut(usize, Result<Item<'a>, FaultKind>)) {
    for statement in statements(text) {
        let mut cursor = Cursor { text, at: statement.at, end: statement.end };
        let item = match statement.keyword {
            "BO_" => message(&mut cursor),
            "SG_" => signal(&mut cursor),
            "VAL_" => texts(&mut cursor),
            "SIG_VALTYPE_" => value_type(&mut cursor),
            "SG_MUL_VAL_" => multiplexer(&mut cursor),
            "BA_DEF_" => values(&mut cursor).or(Some(Item::Other)),
            "BA_DEF_DEF_" => default(&mut cursor),
            "BA_" => attribute(&mut cursor),
            "" => None,
            _ => continue,
        };
        let item = item.filter(|item| *item == Item::Other || cursor.is_at_end());
        if item.is_none() && matches!(statement.keyword, "BO_" | "") {
            take(statement.line, Ok(Item::NoMessage));
        }
        take(statement.line, item.ok_or_else(|| cursor.fault(statement.line_at)));
    }
}

#[derive(Clone, Copy)]
struct Statement<'a> {
    /// Empty for a line that no statement has.
    keyword: &'a str,
    line: usize,
    /// Begin of its line, of what follows its keyword, and its end.
    line_at: usize,
    at: usize,
    end: usize,
}

/// Statements begin in a line of their own or after a semicolon. One that does not end does not take the next one.
fn statements(text: &str) -> Vec<Statement<'_>> {
    let mut all: Vec<Statement<'_>> = Vec::new();
    let (mut line, mut line_at) = (1, 0);
    let (mut may_begin, mut is_open, mut is_quoted, mut is_escaped) = (true, false, false, false);
    let mut skip_to = 0;
    for (at, character) in text.char_indices() {
        let keyword = all.last().map_or("", |statement| statement.keyword);
        if character == '\n' {
            (line, line_at, may_begin) = (line + 1, at + 1, true);
            // Only these have texts of several lines.
            is_quoted &= matches!(keyword, "CM_" | "BA_" | "BA_DEF_DEF_");
            is_open &= !matches!(keyword, "BO_" | "SG_" | "//" | "");
            continue;
        }
        if is_quoted {
            is_quoted = character != '"' || is_escaped;
            is_escaped = character == '\\' && !is_escaped;
            continue;
        }
        if at < skip_to || character.is_whitespace() {
            continue;
        }
        let rest = text.get(at..).unwrap_or_default();
        if std::mem::take(&mut may_begin) {
            let word = word_of(rest);
            let is_listed = keyword == "NS_" && {
                let after = rest.get(word.len()..).unwrap_or_default();
                after.lines().next().is_none_or(|after| after.trim().is_empty())
            };
            if is_listed {
                skip_to = at + word.len();
                continue;
            }
            let is_known = KEYWORDS.contains(&word);
            if is_known || !is_open {
                if let Some(last) = all.last_mut() {
                    last.end = last.end.min(at);
                }
                let is_comment = rest.starts_with("//");
                let keyword = match (is_comment, is_known) {
                    (true, _) => "//",
                    (false, true) => word,
                    (false, false) => "",
                };
                let begin = if is_known { at + word.len() } else { at };
                all.push(Statement { keyword, line, line_at, at: begin, end: text.len() });
                (is_open, skip_to) = (true, begin);
                if is_known {
                    continue;
                }
            }
        }
        match character {
            '"' => is_quoted = true,
            ';' if all.last().is_some_and(|last| !matches!(last.keyword, "//" | "")) => {
                (is_open, may_begin) = (false, true);
                if let Some(last) = all.last_mut() {
                    last.end = last.end.min(at);
                }
            }
            _ => {}
        }
    }
    all
}

/// A word at the begin of a text. Makers begin names with digits, too.
fn word_of(text: &str) -> &str {
    let is_part = |character: char| character.is_ascii_alphanumeric() || character == '_';
    let end = text.find(|character| !is_part(character)).unwrap_or(text.len());
    text.get(..end).unwrap_or_default()
}

struct Cursor<'a> {
    text: &'a str,
    at: usize,
    end: usize,
}

impl<'a> Cursor<'a> {
    fn rest(&mut self) -> &'a str {
        let rest = self.text.get(self.at..self.end).unwrap_or_default();
        let trimmed = rest.trim_start();
        self.at += rest.len() - trimmed.len();
        trimmed
    }

    fn is_at_end(&mut self) -> bool {
        self.rest().is_empty()
    }

    fn take(&mut self, length: usize) -> Option<&'a str> {
        let taken = self.rest().get(..length).filter(|taken| !taken.is_empty())?;
        self.at += length;
        Some(taken)
    }

    fn mark(&mut self, mark: char) -> Option<()> {
        self.rest().starts_with(mark).then(|| self.at += mark.len_utf8())
    }

    fn word(&mut self) -> Option<&'a str> {
        let length = word_of(self.rest()).len();
        self.take(length)
    }

    /// Text of a number, also of one that is too large.
    fn number(&mut self) -> Option<&'a str> {
        let rest = self.rest();
        let unsigned = rest.trim_start_matches(['+', '-']);
        let mut before = ' ';
        let is_other = |character: char| {
            let is_sign = matches!(character, '+' | '-') && matches!(before, 'e' | 'E');
            before = character;
            !(character.is_ascii_digit() || matches!(character, '.' | 'e' | 'E') || is_sign)
        };
        let length = unsigned.find(is_other).unwrap_or(unsigned.len());
        if !unsigned.starts_with(|first: char| first.is_ascii_digit() || first == '.') {
            return None;
        }
        self.take(rest.len() - unsigned.len() + length)
    }

    fn real(&mut self) -> Option<f64> {
        let at = self.at;
        let value = self.number()?.parse().ok();
        if value.is_none() {
            self.at = at;
        }
        value
    }

    /// A text without its quotes, with its escapes.
    fn quoted(&mut self) -> Option<&'a str> {
        let inner = self.rest().strip_prefix('"')?;
        let mut is_escaped = false;
        let length = inner.find(|character| {
            let ends = character == '"' && !is_escaped;
            is_escaped = character == '\\' && !is_escaped;
            ends
        })?;
        self.at += length + 2;
        inner.get(..length)
    }

    fn fault(&self, line_at: usize) -> FaultKind {
        let line = self.text.get(line_at..).and_then(|text| text.lines().next());
        // No control sequence of the file reaches a terminal.
        let printable = |character: char| {
            if character.is_control() { char::REPLACEMENT_CHARACTER } else { character }
        };
        let text = line.unwrap_or_default().trim().chars().take(MAX_QUOTED).map(printable);
        let before = self.text.get(line_at..self.at).unwrap_or_default();
        FaultKind::Syntax { column: before.chars().count() + 1, text: text.collect() }
    }
}

/// A text with its quotes as they are meant.
fn unescaped(text: &str) -> Cow<'_, str> {
    if text.contains("\\\"") { text.replace("\\\"", "\"").into() } else { text.into() }
}

fn message<'a>(cursor: &mut Cursor<'a>) -> Option<Item<'a>> {
    let (id, name) = (cursor.number()?, cursor.word()?);
    cursor.mark(':')?;
    let length = cursor.number()?;
    // The sender may be missing.
    cursor.word();
    Some(Item::Message { id, name, length })
}

fn signal<'a>(cursor: &mut Cursor<'a>) -> Option<Item<'a>> {
    let name = cursor.word()?;
    let multiplexing = match cursor.mark(':') {
        Some(()) => Multiplexing::default(),
        None => {
            let multiplexing = multiplexing(cursor)?;
            cursor.mark(':')?;
            multiplexing
        }
    };
    let start = cursor.number()?;
    cursor.mark('|')?;
    let bits = cursor.number()?;
    cursor.mark('@')?;
    let order = match cursor.rest().chars().next()? {
        '0' => ByteOrder::BigEndian,
        '1' => ByteOrder::LittleEndian,
        _ => return None,
    };
    cursor.take(1)?;
    let is_signed = match cursor.rest().chars().next()? {
        '-' => true,
        '+' => false,
        _ => return None,
    };
    cursor.take(1)?;
    cursor.mark('(')?;
    let factor = cursor.real()?;
    cursor.mark(',')?;
    let offset = cursor.real()?;
    cursor.mark(')')?;
    cursor.mark('[')?;
    let least = cursor.real()?;
    cursor.mark('|')?;
    let most = cursor.real()?;
    cursor.mark(']')?;
    let unit = unescaped(cursor.quoted()?);
    // The receivers.
    while cursor.word().is_some() || cursor.mark(',').is_some() {}
    let range = (least, most);
    Some(Item::Signal {
        name,
        multiplexing,
        start,
        bits,
        order,
        is_signed,
        factor,
        offset,
        range,
        unit,
    })
}

/// `M`, `m3` or `m3M`.
fn multiplexing(cursor: &mut Cursor<'_>) -> Option<Multiplexing> {
    let at = cursor.at;
    let word = cursor.word()?;
    let value = word.strip_suffix('M').unwrap_or(word);
    let read = match value.strip_prefix('m') {
        Some(value) => value.parse().ok().map(Some),
        None => value.is_empty().then_some(None),
    };
    if read.is_none() {
        cursor.at = at;
    }
    Some(Multiplexing { is_multiplexer: word.ends_with('M'), value: read? })
}

/// Those of an environment variable have no effect.
fn texts<'a>(cursor: &mut Cursor<'a>) -> Option<Item<'a>> {
    if !cursor.rest().starts_with(|first: char| first.is_ascii_digit()) {
        return Some(Item::Other);
    }
    let (message, signal) = (cursor.number()?, cursor.word()?);
    let mut texts = Vec::new();
    while !cursor.is_at_end() {
        texts.push((cursor.number()?, unescaped(cursor.quoted()?)));
    }
    Some(Item::Texts { message, signal, texts })
}

fn value_type<'a>(cursor: &mut Cursor<'a>) -> Option<Item<'a>> {
    let (message, signal) = (cursor.number()?, cursor.word()?);
    cursor.mark(':');
    Some(Item::ValueType { message, signal, kind: cursor.number()? })
}

fn multiplexer<'a>(cursor: &mut Cursor<'a>) -> Option<Item<'a>> {
    let (message, signal, multiplexer) = (cursor.number()?, cursor.word()?, cursor.word()?);
    let mut values = Vec::new();
    while !cursor.is_at_end() {
        let least = cursor.number()?.parse().ok()?;
        cursor.mark('-')?;
        values.push(least..=cursor.number()?.parse().ok()?);
        cursor.mark(',');
    }
    Some(Item::Multiplexer { message, signal, multiplexer, values })
}

/// Attributes of other kinds have no effect.
fn values<'a>(cursor: &mut Cursor<'a>) -> Option<Item<'a>> {
    cursor.word().filter(|object| *object == "BO_")?;
    let attribute = cursor.quoted()?;
    cursor.word().filter(|kind| *kind == "ENUM")?;
    let mut values = Vec::new();
    while let Some(value) = cursor.quoted() {
        values.push(value);
        cursor.mark(',');
    }
    Some(Item::Values { attribute, values })
}

fn default<'a>(cursor: &mut Cursor<'a>) -> Option<Item<'a>> {
    let attribute = cursor.quoted()?;
    Some(Item::Default { attribute, value: value(cursor)? })
}

/// Those of the network, a node or an environment variable have no effect.
fn attribute<'a>(cursor: &mut Cursor<'a>) -> Option<Item<'a>> {
    let attribute = cursor.quoted()?;
    let object = match cursor.word() {
        Some(object @ ("BO_" | "SG_")) => object,
        _ => return Some(Item::Other),
    };
    let message = cursor.number()?;
    let signal = if object == "SG_" { Some(cursor.word()?) } else { None };
    Some(Item::Attribute { attribute, message, signal, value: value(cursor)? })
}

fn value<'a>(cursor: &mut Cursor<'a>) -> Option<&'a str> {
    cursor.quoted().or_else(|| cursor.number())
}
