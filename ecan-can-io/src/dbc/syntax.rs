//! Text of a file as items of the grammar.

use std::borrow::Cow;

use can_dbc_pest::{DbcParser, Error, Pair, Parser, Rule};
use pest::error::LineColLocation;

use crate::dbc::fault::{DbcFault, FaultKind};

/// Longest text of a line in a message.
const MAX_QUOTED: usize = 80;

/// Text in UTF-8, or else in Windows-1252, which programs of Windows write.
pub fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text.strip_prefix('\u{FEFF}').unwrap_or(text)),
        Err(_) => can_dbc::decode_cp1252(bytes).unwrap_or(String::from_utf8_lossy(bytes)),
    }
}

/// Items of the file.
pub fn items(text: &str) -> Result<Vec<Pair<'_, Rule>>, DbcFault> {
    let file = DbcParser::parse(Rule::file, text).map_err(|error| fault(text, &error))?;
    // The only pair at this level is the file.
    Ok(file.flat_map(Pair::into_inner).collect())
}

fn fault(text: &str, error: &Error<Rule>) -> DbcFault {
    let (LineColLocation::Pos((line, column)) | LineColLocation::Span((line, column), _)) =
        error.line_col;
    let content = text.lines().nth(line.saturating_sub(1)).unwrap_or_default();
    // No control sequence of the file reaches a terminal.
    let printable = |it: char| if it.is_control() { char::REPLACEMENT_CHARACTER } else { it };
    let text = content.trim().chars().take(MAX_QUOTED).map(printable).collect();
    DbcFault { line, kind: FaultKind::Syntax { column, text } }
}

/// Line of an item, from 1.
pub fn line_of(item: &Pair<'_, Rule>) -> usize {
    item.line_col().0
}

/// First part of an item with this rule.
pub fn part<'a>(item: &Pair<'a, Rule>, rule: Rule) -> Option<Pair<'a, Rule>> {
    item.clone().into_inner().find(|it| it.as_rule() == rule)
}

/// Text of a part; empty if there is none.
pub fn part_text<'a>(item: &Pair<'a, Rule>, rule: Rule) -> &'a str {
    part(item, rule).map_or("", |it| it.as_str())
}

/// Text without its quotes.
pub fn unquoted(text: &str) -> &str {
    text.strip_prefix('"').and_then(|it| it.strip_suffix('"')).unwrap_or(text)
}
