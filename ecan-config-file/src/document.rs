//! A TOML document that is read key by key: every fault is kept with its place, and every key that
//! nobody asked for is one.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use toml::Spanned;
use toml::de::{DeInteger, DeTable, DeValue};

use crate::fault::{FileFault, FileFaults};

/// The faults and places of a text that is being read.
pub(crate) struct Document<'i> {
    text: &'i str,
    /// Where each line starts.
    lines: Vec<usize>,
    faults: Vec<(usize, String)>,
    /// Where the value of a key starts, by its full path.
    places: BTreeMap<String, usize>,
    /// The paths at which a fault is known.
    faulty: Vec<String>,
    syntax_lines: BTreeSet<usize>,
}

impl<'i> Document<'i> {
    /// Parses the text as far as it goes.
    pub(crate) fn parse(text: &'i str) -> (Self, Spanned<DeTable<'i>>) {
        let (root, errors) = DeTable::parse_recoverable(text);
        let mut document = Self {
            text,
            lines: std::iter::once(0)
                .chain(text.match_indices('\n').map(|(at, _)| at + 1))
                .collect(),
            faults: Vec::new(),
            places: BTreeMap::new(),
            faulty: Vec::new(),
            syntax_lines: BTreeSet::new(),
        };
        for error in errors {
            let at = error.span().map_or(0, |span| span.start);
            let (line, _) = document.line_and_column(at);
            document.syntax_lines.insert(line);
            document.faults.push((at, error.message().trim().to_owned()));
        }
        (document, root)
    }

    /// Whether it is TOML at all.
    pub(crate) fn is_sound(&self) -> bool {
        self.syntax_lines.is_empty()
    }

    fn place(&mut self, path: &str, span: &Range<usize>) {
        self.places.insert(path.to_owned(), span.start);
    }

    /// A fault of the value at a path. What follows from a fault of the syntax in the same line is
    /// none of its own.
    pub(crate) fn fault(&mut self, path: &str, at: usize, reason: impl Into<String>) {
        let (line, _) = self.line_and_column(at);
        self.faulty.push(path.to_owned());
        if !self.syntax_lines.contains(&line) {
            self.faults.push((at, reason.into()));
        }
    }

    /// A fault of a byte that is no part of a text.
    pub(crate) fn foreign_byte(&mut self, at: usize, byte: u8) {
        self.faults.push((at, format!("byte 0x{byte:02X} is not UTF-8")));
    }

    /// A fault of what was read, put to the first of these paths that the file has, or what it
    /// stands in. Nothing where a path has a fault already: this one would follow from it.
    pub(crate) fn semantic_fault(&mut self, paths: &[String], reason: String) {
        if paths.iter().any(|path| self.faulty.contains(path)) {
            return;
        }
        let found = paths.iter().find_map(|path| self.places.get(path).copied());
        let around = || paths.first().and_then(|path| self.around(path));
        let at = found.or_else(around).unwrap_or(0);
        self.faults.push((at, reason));
    }

    /// The nearest table around a path.
    fn around(&self, path: &str) -> Option<usize> {
        let (outer, _) = path.rsplit_once('.')?;
        self.places.get(outer).copied().or_else(|| self.around(outer))
    }

    fn line_and_column(&self, at: usize) -> (usize, usize) {
        let at = at.min(self.text.len());
        let line = self.lines.partition_point(|start| *start <= at);
        let start = line.checked_sub(1).and_then(|line| self.lines.get(line)).copied();
        let before = self.text.get(start.unwrap_or(0)..at).unwrap_or_default();
        (line, before.chars().count() + 1)
    }

    /// All faults, in the order of the lines.
    pub(crate) fn finish(mut self) -> Result<(), FileFaults> {
        self.faults.sort();
        self.faults.dedup();
        let located = |(at, reason): &(usize, String)| {
            let (line, column) = self.line_and_column(*at);
            FileFault { line, column, reason: reason.clone() }
        };
        let faults: Vec<_> = self.faults.iter().map(located).collect();
        if faults.is_empty() { Ok(()) } else { Err(FileFaults(faults)) }
    }
}

/// A table that is being read.
pub(crate) struct Table<'t, 'i> {
    path: String,
    table: &'t DeTable<'i>,
    at: usize,
    known: Vec<&'static str>,
}

impl<'t, 'i> Table<'t, 'i> {
    pub(crate) fn root(table: &'t Spanned<DeTable<'i>>) -> Self {
        Self { path: String::new(), table: table.get_ref(), at: 0, known: Vec::new() }
    }

    fn nested(
        document: &mut Document<'_>,
        path: String,
        value: &'t Spanned<DeValue<'i>>,
    ) -> Option<Self> {
        let span = value.span();
        document.place(&path, &span);
        match value.get_ref() {
            DeValue::Table(table) => Some(Self { path, table, at: span.start, known: Vec::new() }),
            other => {
                let reason = format!("`{path}` is a table, not {}", kind(other));
                document.fault(&path, span.start, reason);
                None
            }
        }
    }

    /// The path of a key of this table.
    pub(crate) fn path(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// A value; asking makes its key known.
    fn value(
        &mut self,
        document: &mut Document<'_>,
        key: &'static str,
    ) -> Option<&'t Spanned<DeValue<'i>>> {
        self.known.push(key);
        let value = self.table.get(key)?;
        document.place(&self.path(key), &value.span());
        Some(value)
    }

    /// Whether the key is there.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    /// A fault of a key, or of the table where the key is not there.
    pub(crate) fn fault(&self, document: &mut Document<'_>, key: &str, reason: impl Into<String>) {
        let at = self.table.get(key).map_or(self.at, |value| value.span().start);
        document.fault(&self.path(key), at, reason);
    }

    fn wrong(&self, document: &mut Document<'_>, key: &str, wanted: &str, found: &DeValue<'_>) {
        self.fault(document, key, format!("`{key}` is {wanted}, not {}", kind(found)));
    }

    /// A table in this one.
    pub(crate) fn table(
        &mut self,
        document: &mut Document<'_>,
        key: &'static str,
    ) -> Option<Table<'t, 'i>> {
        let path = self.path(key);
        let value = self.value(document, key)?;
        Table::nested(document, path, value)
    }

    /// An array of tables.
    pub(crate) fn tables(
        &mut self,
        document: &mut Document<'_>,
        key: &'static str,
    ) -> Vec<Table<'t, 'i>> {
        let Some(value) = self.value(document, key) else { return Vec::new() };
        let DeValue::Array(array) = value.get_ref() else {
            let reason = format!("`{key}` is a list of tables, [[{}]]", self.path(key));
            self.fault(document, key, reason);
            return Vec::new();
        };
        let path = self.path(key);
        let nested = array.iter().enumerate();
        nested
            .filter_map(|(at, value)| Table::nested(document, format!("{path}[{at}]"), value))
            .collect()
    }

    /// A whole number from `min` to `max`.
    pub(crate) fn unsigned(
        &mut self,
        document: &mut Document<'_>,
        key: &'static str,
        (min, max): (u32, u32),
    ) -> Option<u32> {
        let value = self.value(document, key)?;
        match value.get_ref() {
            DeValue::Integer(number) => {
                let number = integer(number);
                let in_range = number
                    .and_then(|number| u32::try_from(number).ok())
                    .filter(|number| (min..=max).contains(number));
                if in_range.is_none() {
                    let found = number.map_or_else(|| "too great".to_owned(), |it| it.to_string());
                    let reason = format!("`{key}` is {found}, possible is {min}..{max}");
                    self.fault(document, key, reason);
                }
                in_range
            }
            other => {
                self.wrong(document, key, "a whole number", other);
                None
            }
        }
    }

    /// A number with a fraction or without, times `scale`, to the nearest whole number.
    fn scaled(
        &self,
        document: &mut Document<'_>,
        key: &'static str,
        value: &DeValue<'_>,
        scale: f64,
        max: f64,
    ) -> Option<u32> {
        let number = match value {
            DeValue::Integer(number) => integer(number).map(|number| number as f64),
            DeValue::Float(number) => number.as_str().replace('_', "").parse().ok(),
            other => {
                self.wrong(document, key, "a decimal number", other);
                return None;
            }
        };
        let in_range = number.filter(|number| (0.0..=max).contains(number));
        if in_range.is_none() {
            let found = number.map_or_else(|| "too great".to_owned(), |it: f64| it.to_string());
            self.fault(document, key, format!("`{key}` is {found}, possible is 0..{max}"));
        }
        in_range.map(|number| (number * scale).round() as u32)
    }

    /// A time in microseconds, as nanoseconds.
    pub(crate) fn microseconds(
        &mut self,
        document: &mut Document<'_>,
        key: &'static str,
    ) -> Option<u32> {
        let value = self.value(document, key)?;
        self.scaled(document, key, value.get_ref(), 1_000.0, 4_000_000.0)
    }

    /// One percentage or a list of two, in 0.1 %.
    pub(crate) fn permille_window(
        &mut self,
        document: &mut Document<'_>,
        key: &'static str,
    ) -> Option<[u32; 2]> {
        let value = self.value(document, key)?;
        let mut one = |value: &DeValue<'_>| self.scaled(document, key, value, 10.0, 100.0);
        match value.get_ref() {
            DeValue::Array(array) => match array.iter().collect::<Vec<_>>()[..] {
                [min, max] => Some([one(min.get_ref())?, one(max.get_ref())?]),
                _ => {
                    let reason = format!("`{key}` is one percentage, or [least, greatest]");
                    self.fault(document, key, reason);
                    None
                }
            },
            value => one(value).map(|point| [point; 2]),
        }
    }

    /// True or false.
    pub(crate) fn flag(&mut self, document: &mut Document<'_>, key: &'static str) -> Option<bool> {
        let value = self.value(document, key)?.get_ref();
        if let DeValue::Boolean(flag) = value {
            return Some(*flag);
        }
        self.wrong(document, key, "true or false", value);
        None
    }

    /// One of these words.
    pub(crate) fn word<T: Copy>(
        &mut self,
        document: &mut Document<'_>,
        key: &'static str,
        words: &[(&str, T)],
    ) -> Option<T> {
        let value = self.value(document, key)?;
        self.one_word(document, key, value, words)
    }

    fn one_word<T: Copy>(
        &self,
        document: &mut Document<'_>,
        key: &'static str,
        value: &Spanned<DeValue<'_>>,
        words: &[(&str, T)],
    ) -> Option<T> {
        let text = value.get_ref().as_str();
        let found = text.and_then(|text| words.iter().find(|(word, _)| *word == text));
        if found.is_none() {
            let possible: Vec<_> = words.iter().map(|(word, _)| format!("\"{word}\"")).collect();
            let what = match text {
                Some(text) => format!("\"{text}\""),
                None => kind(value.get_ref()).to_owned(),
            };
            let reason = format!("`{key}` is {what}, possible is {}", possible.join(", "));
            document.fault(&self.path(key), value.span().start, reason);
        }
        found.map(|(_, meaning)| *meaning)
    }

    /// A list of these words.
    pub(crate) fn words<T: Copy>(
        &mut self,
        document: &mut Document<'_>,
        key: &'static str,
        words: &[(&str, T)],
    ) -> Option<Vec<T>> {
        let value = self.value(document, key)?.get_ref();
        let DeValue::Array(array) = value else {
            self.wrong(document, key, "a list of words", value);
            return None;
        };
        // All of them, so that each wrong one is told.
        let meanings: Vec<_> =
            array.iter().map(|value| self.one_word(document, key, value, words)).collect();
        meanings.into_iter().collect()
    }

    /// The end of the table: what nobody asked for is not known.
    pub(crate) fn finish(self, document: &mut Document<'_>) {
        for key in self.table.keys() {
            let name: &str = key.get_ref();
            if self.known.contains(&name) {
                continue;
            }
            let hint = match closest(name, &self.known) {
                Some(near) => format!("; did you mean `{near}`?"),
                None => format!("; known are {}", self.known.join(", ")),
            };
            let reason = format!("there is no key `{name}` here{hint}");
            document.fault(&self.path(name), key.span().start, reason);
        }
    }
}

/// `None` where it does not fit 64 bits.
fn integer(number: &DeInteger<'_>) -> Option<i64> {
    let digits = number.as_str().replace('_', "");
    i64::from_str_radix(digits.trim_start_matches('+'), number.radix()).ok()
}

fn kind(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a text",
        DeValue::Integer(_) => "a whole number",
        DeValue::Float(_) => "a number with a fraction",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

/// The known key that a typing error may stand for.
fn closest(name: &str, known: &[&'static str]) -> Option<&'static str> {
    let distances = known.iter().map(|key| (distance(name, key), *key));
    distances.min().filter(|(distance, _)| *distance <= 2).map(|(_, key)| key)
}

/// Letters to add, remove or change.
fn distance(from: &str, to: &str) -> usize {
    let to: Vec<char> = to.chars().collect();
    let mut row: Vec<usize> = (0..=to.len()).collect();
    for (nth, letter) in from.chars().enumerate() {
        let mut diagonal = nth;
        let mut left = nth + 1;
        if let Some(first) = row.first_mut() {
            *first = left;
        }
        for (place, other) in row.iter_mut().skip(1).zip(&to) {
            let changed = diagonal + usize::from(letter != *other);
            diagonal = *place;
            left = changed.min(left + 1).min(*place + 1);
            *place = left;
        }
    }
    row.last().copied().unwrap_or(0)
}
