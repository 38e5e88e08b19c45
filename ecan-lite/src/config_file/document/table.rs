//! A table of a document, the keys of it that are read, and the forms of their values.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use ecan_protocol::text::{Printable, closest};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::{Document, Includes};

/// A table, and the keys of it that were read. Each other key is a fault when the table is dropped.
pub(crate) struct Table<'t, 'i> {
    pub(super) document: &'t Document<'i>,
    path: String,
    pub(super) table: &'t DeTable<'i>,
    at: usize,
    known: Vec<&'static str>,
    /// Every key is known.
    pub(super) is_open: bool,
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
    pub(super) fn value(&mut self, key: &'static str) -> Option<&'t Spanned<DeValue<'i>>> {
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

    pub(super) fn record(&self, key: &'static str, form: impl FnOnce() -> Form) {
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
            let reason = format!("unknown key `{}`{hint}", Printable(name));
            self.document.fault(&self.path(name), key.span().start, reason);
        }
    }
}

pub(super) fn kind(value: &DeValue<'_>) -> &'static str {
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

/// Form of the value of a key.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Form {
    Flag,
    Integer { min: i64, max: i64 },
    Number { min: f64, max: f64 },
    AnyNumber,
    Text,
    Texts,
    Date,
    Word(Vec<String>),
    Words(Vec<String>),
    Integers { min: u32, max: u32, count: Option<usize> },
    Percentages,
    Table,
    Tables,
    TableOrTables,
}

/// Keys that the functions that read a file ask for, by the paths of their tables.
#[derive(Debug, Default)]
pub(crate) struct Recorder {
    pub(in crate::config_file) keys: RefCell<BTreeMap<String, BTreeMap<&'static str, Form>>>,
    /// Paths of keys whose absence is a fault.
    pub(in crate::config_file) required: RefCell<BTreeSet<String>>,
    /// Tables that may have any key.
    pub(in crate::config_file) open: RefCell<BTreeSet<String>>,
}

impl Recorder {
    pub(crate) fn key(&self, table: &str, key: &'static str, form: Form) {
        self.keys.borrow_mut().entry(table.to_owned()).or_default().entry(key).or_insert(form);
    }

    pub(crate) fn required(&self, path: &str) {
        self.required.borrow_mut().insert(path.to_owned());
    }

    pub(crate) fn open(&self, table: &str) {
        self.open.borrow_mut().insert(table.to_owned());
    }
}
