//! Keys of a file with the forms of their values, recorded while the functions that read a file ask for them.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

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
