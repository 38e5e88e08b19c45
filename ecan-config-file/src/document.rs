//! A TOML document that is read key by key. Every fault is kept with its location, and each key that
//! is not read is a fault.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::PathBuf;

use toml::Spanned;
use toml::de::{DeInteger, DeTable, DeValue};

use crate::fault::FileFaults;
use crate::located::Located;
use crate::schema::{Form, Recorder};
use crate::text_lines::TextLines;

/// Files that a text may include, by their names in it.
#[derive(Clone, Debug, Default)]
pub(crate) enum Includes {
    #[default]
    None,
    /// The names are relative to a directory.
    Directory(PathBuf),
    Texts(BTreeMap<String, String>),
}

/// Faults and locations of a text.
pub(crate) struct Document<'i> {
    text: TextLines<'i>,
    includes: Includes,
    faults: RefCell<Vec<(usize, String)>>,
    /// Start of the value of each key, by its full path.
    locations: RefCell<BTreeMap<String, usize>>,
    /// Paths with a known fault.
    faulty: RefCell<Vec<String>>,
    syntax_lines: BTreeSet<usize>,
    /// Notes the keys that are asked for: the text is empty then.
    recorder: Option<Recorder>,
}

impl Document<'_> {
    /// Calls the functions that read a file with an empty one, and notes what they ask for.
    pub(crate) fn record(read: impl FnOnce(&Document<'_>, &Spanned<DeTable<'_>>)) -> Recorder {
        let (mut document, root) = Document::parse("");
        document.recorder = Some(Recorder::default());
        read(&document, &root);
        document.recorder.unwrap_or_default()
    }

    /// Reads the bytes of a file with the files that it may include.
    ///
    /// # Errors
    /// Every fault, also of the syntax; bytes that are not UTF-8 do not hide others.
    pub(crate) fn read<T>(
        bytes: &[u8],
        includes: Includes,
        read: impl FnOnce(&Document<'_>, &Spanned<DeTable<'_>>) -> T,
    ) -> Result<T, FileFaults> {
        let mut text = String::with_capacity(bytes.len());
        let mut invalid = Vec::new();
        for chunk in bytes.utf8_chunks() {
            text.push_str(chunk.valid());
            if let Some(byte) = chunk.invalid().first() {
                invalid.push((text.len(), *byte));
                text.push(char::REPLACEMENT_CHARACTER);
            }
        }
        let (mut document, root) = Document::parse(&text);
        document.includes = includes;
        for (at, byte) in invalid {
            document.push(at, format!("byte 0x{byte:02X} is not UTF-8"));
        }
        let content = read(&document, &root);
        document.finish()?;
        Ok(content)
    }
}

impl<'i> Document<'i> {
    /// Parses the text; faults of the syntax do not end it.
    fn parse(text: &'i str) -> (Self, Spanned<DeTable<'i>>) {
        let (root, errors) = DeTable::parse_recoverable(text);
        let mut document = Self {
            text: TextLines::new(text),
            includes: Includes::None,
            faults: RefCell::default(),
            locations: RefCell::default(),
            faulty: RefCell::default(),
            syntax_lines: BTreeSet::new(),
            recorder: None,
        };
        for error in errors {
            let at = error.span().map_or(0, |span| span.start);
            let (line, _) = document.text.line_and_column(at);
            document.syntax_lines.insert(line);
            document.push(at, error.message().trim());
        }
        (document, root)
    }

    /// True if the text has no fault of the syntax.
    pub(crate) fn is_valid_toml(&self) -> bool {
        self.syntax_lines.is_empty()
    }

    /// Reports a fault at a location.
    pub(crate) fn push(&self, at: usize, reason: impl Into<String>) {
        self.faults.borrow_mut().push((at, reason.into()));
    }

    fn locate(&self, path: &str, span: &Range<usize>) {
        self.locations.borrow_mut().insert(path.to_owned(), span.start);
    }

    /// Reports a fault of the value at a path. A consequence of a fault of the syntax in the same line
    /// is not reported.
    fn fault(&self, path: &str, at: usize, reason: impl Into<String>) {
        if let Some(recorder) = &self.recorder {
            // The file is empty: it lacks the key.
            recorder.required(path);
        }
        let (line, _) = self.text.line_and_column(at);
        self.faulty.borrow_mut().push(path.to_owned());
        if !self.syntax_lines.contains(&line) {
            self.push(at, reason);
        }
    }

    /// True if a fault of this path is known.
    fn is_faulty(&self, path: &str) -> bool {
        self.faulty.borrow().iter().any(|faulty| faulty == path)
    }

    /// Reports a fault of the values at the first of these paths that the file has, or at the table
    /// around it. Not reported if a path already has a fault: this one would be its consequence.
    pub(crate) fn semantic_fault(&self, paths: &[String], reason: String) {
        if paths.iter().any(|path| self.is_faulty(path)) {
            return;
        }
        let found = paths.iter().find_map(|path| self.locations.borrow().get(path).copied());
        let around = || paths.first().and_then(|path| self.around(path));
        self.push(found.or_else(around).unwrap_or(0), reason);
    }

    /// The nearest table around a path.
    fn around(&self, path: &str) -> Option<usize> {
        let (outer, _) = path.rsplit_once('.')?;
        self.locations.borrow().get(outer).copied().or_else(|| self.around(outer))
    }

    /// Returns all faults in the order of the lines.
    ///
    /// # Errors
    /// The faults, if there are any.
    fn finish(self) -> Result<(), FileFaults> {
        self.text.finish(self.faults.take())
    }
}

/// A table, and the keys of it that were read. Each other key is a fault when the table is dropped.
pub(crate) struct Table<'t, 'i> {
    document: &'t Document<'i>,
    path: String,
    table: &'t DeTable<'i>,
    at: usize,
    known: Vec<&'static str>,
    /// Every key is known.
    is_open: bool,
}

impl<'t, 'i> Table<'t, 'i> {
    pub(crate) fn root(document: &'t Document<'i>, table: &'t Spanned<DeTable<'i>>) -> Self {
        Self {
            document,
            path: String::new(),
            table: table.get_ref(),
            at: 0,
            known: Vec::new(),
            is_open: false,
        }
    }

    fn nested(
        document: &'t Document<'i>,
        path: String,
        value: &'t Spanned<DeValue<'i>>,
    ) -> Option<Self> {
        let span = value.span();
        document.locate(&path, &span);
        match value.get_ref() {
            DeValue::Table(table) => Some(Self {
                document,
                path,
                table,
                at: span.start,
                known: Vec::new(),
                is_open: false,
            }),
            other => {
                let reason = format!("`{path}` must be a table, not {}", kind(other));
                document.fault(&path, span.start, reason);
                None
            }
        }
    }

    /// Path of this table in the file.
    pub(crate) fn own_path(&self) -> &str {
        &self.path
    }

    /// Path of a key in the file.
    pub(crate) fn path(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// The value of a key, which becomes known.
    fn value(&mut self, key: &'static str) -> Option<&'t Spanned<DeValue<'i>>> {
        if !self.known.contains(&key) {
            self.known.push(key);
        }
        let value = self.table.get(key)?;
        self.document.locate(&self.path(key), &value.span());
        Some(value)
    }

    /// True if the keys are recorded, and not read.
    pub(crate) fn is_recorded(&self) -> bool {
        self.document.recorder.is_some()
    }

    fn record(&self, key: &'static str, form: impl FnOnce() -> Form) {
        if let Some(recorder) = &self.document.recorder {
            recorder.key(&self.path, key, form());
        }
    }

    /// A table of a recorded key, with this path.
    fn recorded(&self, path: String) -> Option<Self> {
        self.is_recorded().then(|| Self {
            document: self.document,
            path,
            table: self.table,
            at: 0,
            known: Vec::new(),
            is_open: false,
        })
    }

    /// True if a fault of the key is known.
    pub(crate) fn is_faulty(&self, key: &str) -> bool {
        self.document.is_faulty(&self.path(key))
    }

    /// True if the file has the key.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    /// Reports a fault of a key, or of the table if it does not have the key.
    pub(crate) fn fault(&self, key: &str, reason: impl Into<String>) {
        let at = self.table.get(key).map_or(self.at, |value| value.span().start);
        self.document.fault(&self.path(key), at, reason);
    }

    fn wrong(&self, key: &str, expected: &str, found: &DeValue<'_>) {
        self.fault(key, format!("`{key}` must be {expected}, not {}", kind(found)));
    }

    fn out_of_range(
        &self,
        key: &str,
        found: Option<impl std::fmt::Display>,
        min: impl std::fmt::Display,
        max: impl std::fmt::Display,
    ) {
        let found = match found {
            Some(found) => format!("= {found} is out of range"),
            None => "is too large".to_owned(),
        };
        self.fault(key, format!("`{key}` {found}; allowed: {min} to {max}"));
    }

    /// Location of the table.
    pub(crate) fn at(&self) -> usize {
        self.at
    }

    /// Location of the value of a key, or of the table without it.
    pub(crate) fn location(&self, key: &str) -> usize {
        self.table.get(key).map_or(self.at, |value| value.span().start)
    }

    /// Reports a fault at a location of this document.
    pub(crate) fn fault_at(&self, at: usize, reason: String) {
        self.document.push(at, reason);
    }

    /// An integer from `min` to `max`; its absence is a fault.
    pub(crate) fn required(
        &mut self,
        key: &'static str,
        what: &str,
        range: (u32, u32),
    ) -> Option<u32> {
        if !self.has(key) {
            self.fault(key, format!("`{key}` is missing: {what}"));
        }
        self.unsigned(key, range)
    }

    /// All keys of a table of numbers, truth values and strings, with their locations and the texts
    /// of their values.
    pub(crate) fn scalars(&mut self) -> Vec<(String, usize, String)> {
        self.is_open = true;
        if let Some(recorder) = &self.document.recorder {
            recorder.open(&self.path);
        }
        let mut scalars = Vec::new();
        for (key, value) in self.table {
            let name: &str = key.get_ref();
            let at = value.span().start;
            let text = match value.get_ref() {
                DeValue::String(text) => text.to_string(),
                DeValue::Integer(number) => match integer(number) {
                    Some(number) => number.to_string(),
                    None => {
                        self.document.fault(&self.path(name), at, format!("`{name}` is too large"));
                        continue;
                    }
                },
                DeValue::Float(number) => number.as_str().replace('_', ""),
                DeValue::Boolean(flag) => u8::from(*flag).to_string(),
                other => {
                    let expected = "a number, true, false or a string";
                    let reason = format!("`{name}` must be {expected}, not {}", kind(other));
                    self.document.fault(&self.path(name), at, reason);
                    continue;
                }
            };
            scalars.push((name.to_owned(), at, text));
        }
        scalars
    }

    /// A date, with or without a time of day.
    pub(crate) fn datetime(&mut self, key: &'static str) -> Option<toml::value::Datetime> {
        self.record(key, || Form::Date);
        let value = self.value(key)?.get_ref();
        if let DeValue::Datetime(datetime) = value {
            return Some(*datetime);
        }
        self.wrong(key, "a date and time, 2026-01-31T12:00:00", value);
        None
    }

    /// A list of strings with their locations.
    pub(crate) fn texts(&mut self, key: &'static str) -> Option<Vec<Located<String>>> {
        self.record(key, || Form::Texts);
        let value = self.value(key)?.get_ref();
        let DeValue::Array(array) = value else {
            self.wrong(key, "an array of strings", value);
            return None;
        };
        let mut texts = Vec::new();
        for value in array.iter() {
            match value.get_ref().as_str() {
                Some(text) => texts.push(Located::new(text.to_owned(), value.span().start)),
                None => {
                    self.wrong(key, "an array of strings", value.get_ref());
                    return None;
                }
            }
        }
        Some(texts)
    }

    /// A table in this one.
    pub(crate) fn table(&mut self, key: &'static str) -> Option<Table<'t, 'i>> {
        self.record(key, || Form::Table);
        let path = self.path(key);
        let Some(value) = self.value(key) else { return self.recorded(path) };
        Table::nested(self.document, path, value)
    }

    /// An array of tables.
    pub(crate) fn tables(&mut self, key: &'static str) -> Vec<Table<'t, 'i>> {
        self.record(key, || Form::Tables);
        let Some(value) = self.value(key) else {
            return self.recorded(format!("{}[0]", self.path(key))).into_iter().collect();
        };
        let DeValue::Array(array) = value.get_ref() else {
            let reason = format!("`{key}` must be an array of tables, [[{}]]", self.path(key));
            self.fault(key, reason);
            return Vec::new();
        };
        let path = self.path(key);
        let nested = array.iter().enumerate();
        nested
            .filter_map(|(at, value)| Table::nested(self.document, format!("{path}[{at}]"), value))
            .collect()
    }

    /// A table, or an array of tables.
    pub(crate) fn one_or_more(&mut self, key: &'static str) -> Vec<Table<'t, 'i>> {
        match self.table.get(key).map(Spanned::get_ref) {
            Some(DeValue::Table(_)) => self.table(key).into_iter().collect(),
            Some(_) => self.tables(key),
            None => {
                self.record(key, || Form::TableOrTables);
                self.tables(key)
            }
        }
    }

    /// Files that the text may include.
    pub(crate) fn includes(&self) -> &'t Includes {
        &self.document.includes
    }

    /// A string.
    pub(crate) fn text(&mut self, key: &'static str) -> Option<&'t str> {
        self.record(key, || Form::Text);
        let value = self.value(key)?.get_ref();
        if value.as_str().is_none() {
            self.wrong(key, "a string", value);
        }
        value.as_str()
    }

    /// A list of two integers from `min` to `max`.
    pub(crate) fn pair(&mut self, key: &'static str, (min, max): (u32, u32)) -> Option<(u32, u32)> {
        self.record(key, || Form::Integers { min, max, count: Some(2) });
        let value = self.value(key)?.get_ref();
        match integers(value, (min, max)).as_deref() {
            Some([first, last]) => Some((*first, *last)),
            _ => {
                self.fault(
                    key,
                    format!("`{key}` must be two integers from {min} to {max}: [a, b]"),
                );
                None
            }
        }
    }

    /// A list of integers from `min` to `max`.
    pub(crate) fn unsigned_list(
        &mut self,
        key: &'static str,
        (min, max): (u32, u32),
    ) -> Option<Vec<u32>> {
        self.record(key, || Form::Integers { min, max, count: None });
        let value = self.value(key)?.get_ref();
        let numbers = integers(value, (min, max));
        if numbers.is_none() {
            self.fault(key, format!("`{key}` must be an array of integers from {min} to {max}"));
        }
        numbers
    }

    /// An integer from `min` to `max`, which fits `T`.
    pub(crate) fn unsigned<T: TryFrom<u32>>(
        &mut self,
        key: &'static str,
        (min, max): (u32, u32),
    ) -> Option<T> {
        self.record(key, || Form::Integer { min: min.into(), max: max.into() });
        let value = self.value(key)?;
        match value.get_ref() {
            DeValue::Integer(number) => {
                let number = integer(number);
                let in_range = number
                    .and_then(|number| u32::try_from(number).ok())
                    .filter(|number| (min..=max).contains(number));
                if in_range.is_none() {
                    self.out_of_range(key, number, min, max);
                }
                in_range.and_then(|number| T::try_from(number).ok())
            }
            other => {
                self.wrong(key, "an integer", other);
                None
            }
        }
    }

    /// A signed integer.
    pub(crate) fn signed(&mut self, key: &'static str) -> Option<i32> {
        self.record(key, || Form::Integer { min: i32::MIN.into(), max: i32::MAX.into() });
        let value = self.value(key)?;
        match value.get_ref() {
            DeValue::Integer(number) => {
                let number = integer(number);
                let in_range = number.and_then(|number| i32::try_from(number).ok());
                if in_range.is_none() {
                    self.out_of_range(key, number, i32::MIN, i32::MAX);
                }
                in_range
            }
            other => {
                self.wrong(key, "an integer", other);
                None
            }
        }
    }

    /// An integer or float. Its range is checked by the configuration.
    pub(crate) fn float(&mut self, key: &'static str) -> Option<f64> {
        self.record(key, || Form::AnyNumber);
        let value = self.value(key)?;
        let number = self.number(key, value.get_ref())?;
        if number.is_none() {
            self.fault(key, format!("`{key}` is too large"));
        }
        number
    }

    /// A number; `Some(None)` if it does not fit its type, `None` if it is none.
    fn number(&self, key: &'static str, value: &DeValue<'_>) -> Option<Option<f64>> {
        match value {
            DeValue::Integer(number) => Some(integer(number).map(|number| number as f64)),
            DeValue::Float(number) => Some(number.as_str().replace('_', "").parse().ok()),
            other => {
                self.wrong(key, "a number", other);
                None
            }
        }
    }

    /// An integer or float times `scale`, rounded.
    fn scaled(&self, key: &'static str, value: &DeValue<'_>, scale: f64, max: f64) -> Option<u32> {
        let number = self.number(key, value)?;
        let in_range = number.filter(|number| (0.0..=max).contains(number));
        if in_range.is_none() {
            self.out_of_range(key, number, 0, max);
        }
        in_range.map(|number| (number * scale).round() as u32)
    }

    /// A time in microseconds, as nanoseconds.
    pub(crate) fn microseconds(&mut self, key: &'static str) -> Option<u32> {
        const MAX_US: f64 = 4_000_000.0;
        self.record(key, || Form::Number { min: 0.0, max: MAX_US });
        let value = self.value(key)?;
        self.scaled(key, value.get_ref(), 1_000.0, MAX_US)
    }

    /// One percentage or a list of two, in 0.1 %.
    pub(crate) fn permille_window(&mut self, key: &'static str) -> Option<[u32; 2]> {
        self.record(key, || Form::Percentages);
        let value = self.value(key)?;
        let one = |value: &DeValue<'_>| self.scaled(key, value, 10.0, 100.0);
        match value.get_ref() {
            DeValue::Array(array) => match array.iter().collect::<Vec<_>>()[..] {
                [min, max] => Some([one(min.get_ref())?, one(max.get_ref())?]),
                _ => {
                    let reason = format!("`{key}` must be one percentage, or [min, max]");
                    self.fault(key, reason);
                    None
                }
            },
            value => one(value).map(|point| [point; 2]),
        }
    }

    /// True or false.
    pub(crate) fn flag(&mut self, key: &'static str) -> Option<bool> {
        self.record(key, || Form::Flag);
        let value = self.value(key)?.get_ref();
        if let DeValue::Boolean(flag) = value {
            return Some(*flag);
        }
        self.wrong(key, "true or false", value);
        None
    }

    /// One of these words.
    pub(crate) fn word<T: Copy>(
        &mut self,
        key: &'static str,
        words: &[(impl AsRef<str>, T)],
    ) -> Option<T> {
        self.record(key, || Form::Word(texts(words)));
        let value = self.value(key)?;
        self.one_word(key, value, words)
    }

    fn one_word<T: Copy>(
        &self,
        key: &'static str,
        value: &Spanned<DeValue<'_>>,
        words: &[(impl AsRef<str>, T)],
    ) -> Option<T> {
        let text = value.get_ref().as_str();
        let found = text.and_then(|text| words.iter().find(|(word, _)| word.as_ref() == text));
        if found.is_none() {
            let allowed: Vec<_> =
                words.iter().map(|(word, _)| format!("\"{}\"", word.as_ref())).collect();
            let what = match text {
                Some(text) => format!("\"{text}\""),
                None => kind(value.get_ref()).to_owned(),
            };
            let reason = format!("`{key}` = {what} is invalid; allowed: {}", allowed.join(", "));
            self.document.fault(&self.path(key), value.span().start, reason);
        }
        found.map(|(_, meaning)| *meaning)
    }

    /// A list of these words.
    pub(crate) fn words<T: Copy>(
        &mut self,
        key: &'static str,
        words: &[(impl AsRef<str>, T)],
    ) -> Option<Vec<T>> {
        self.record(key, || Form::Words(texts(words)));
        let value = self.value(key)?.get_ref();
        let DeValue::Array(array) = value else {
            self.wrong(key, "an array of words", value);
            return None;
        };
        // All words are read, so that each wrong one is reported.
        let meanings: Vec<_> = array.iter().map(|value| self.one_word(key, value, words)).collect();
        meanings.into_iter().collect()
    }
}

impl Drop for Table<'_, '_> {
    fn drop(&mut self) {
        for key in self.table.keys() {
            let name: &str = key.get_ref();
            if self.is_open || self.known.contains(&name) {
                continue;
            }
            let hint = match closest(name, &self.known) {
                Some(near) => format!("; did you mean `{near}`?"),
                None => format!("; known keys: {}", self.known.join(", ")),
            };
            let reason = format!("unknown key `{name}`{hint}");
            self.document.fault(&self.path(name), key.span().start, reason);
        }
    }
}

fn texts<T>(words: &[(impl AsRef<str>, T)]) -> Vec<String> {
    words.iter().map(|(word, _)| word.as_ref().to_owned()).collect()
}

/// Replaces a default by a value of the file.
pub(crate) fn store<T>(target: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *target = value;
    }
}

/// `None` if it does not fit into 64 bits.
fn integer(number: &DeInteger<'_>) -> Option<i64> {
    let digits = number.as_str().replace('_', "");
    i64::from_str_radix(digits.trim_start_matches('+'), number.radix()).ok()
}

/// The integers of an array; `None` for another value, or with an integer out of range.
fn integers(value: &DeValue<'_>, (min, max): (u32, u32)) -> Option<Vec<u32>> {
    let numbers = value.as_array()?.iter().map(|it| integer(it.get_ref().as_integer()?));
    numbers
        .map(|number| u32::try_from(number?).ok().filter(|it| (min..=max).contains(it)))
        .collect()
}

fn kind(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a string",
        DeValue::Integer(_) => "an integer",
        DeValue::Float(_) => "a float",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "an array",
        DeValue::Table(_) => "a table",
    }
}

/// The known key that a misspelled one may mean.
fn closest(name: &str, known: &[&'static str]) -> Option<&'static str> {
    let distances = known.iter().map(|key| (distance(name, key), *key));
    distances.min().filter(|(distance, _)| *distance <= 2).map(|(_, key)| key)
}

/// Number of letters to add, remove or change.
fn distance(from: &str, to: &str) -> usize {
    let to: Vec<char> = to.chars().collect();
    let mut row: Vec<usize> = (0..=to.len()).collect();
    for (nth, letter) in from.chars().enumerate() {
        let mut diagonal = nth;
        let mut left = nth + 1;
        if let Some(first) = row.first_mut() {
            *first = left;
        }
        for (cell, other) in row.iter_mut().skip(1).zip(&to) {
            let changed = diagonal + usize::from(letter != *other);
            diagonal = *cell;
            left = changed.min(left + 1).min(*cell + 1);
            *cell = left;
        }
    }
    row.last().copied().unwrap_or(0)
}
