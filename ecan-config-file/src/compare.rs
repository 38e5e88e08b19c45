//! A device against a startup sequence, entry by entry.

use std::collections::BTreeMap;
use std::fmt;

use ecan_host::{Diagnostics, Error, Expectation, StartupStep};
use ecan_protocol::config::CacheDepth;
use ecan_protocol::object::{SdoWrite, describe, lookup, object};

use crate::filter_compare::{self, FilterList};

/// What an entry should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expected {
    /// What the file sets.
    Value(u32),
    /// What a readback must meet.
    Readback(Expectation),
    /// That the device puts the filter into the editing window.
    Loaded,
}

impl fmt::Display for Expected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Value(value) => write!(f, "{value}"),
            Self::Readback(expected) => write!(f, "{expected}"),
            Self::Loaded => f.write_str("loaded"),
        }
    }
}

/// An entry in which a device and a file differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Index of the object.
    pub index: u16,
    /// Subindex of the entry; of a filter that of the editing window.
    pub subindex: u8,
    /// Index of the filter in its list, for an entry of a filter.
    pub filter: Option<u8>,
    /// What the file says.
    pub expected: Expected,
    /// What the device has.
    pub found: u32,
    /// Whether the master sets the entry up at each start: the PDO assignment, and what is active of
    /// a profile. The Flash does not keep these, so that they differ from power-up until then.
    pub is_set_at_start: bool,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", describe(self.index, self.subindex))?;
        if let Some(filter) = self.filter {
            write!(f, " of filter {filter}")?;
        }
        let entry = lookup(self.index, self.subindex).map(|(_, entry)| entry);
        let meaning = |value| match entry.and_then(|entry| entry.meaning(value)) {
            Some(words) => format!(" ({words})"),
            None => String::new(),
        };
        let wanted = match self.expected {
            Expected::Value(value) => meaning(value),
            Expected::Readback(_) => String::new(),
            Expected::Loaded => {
                let found = self.found;
                return write!(f, ": the device does not load it, {found}{}", meaning(found));
            }
        };
        let (expected, found) = (self.expected, self.found);
        write!(f, ": the file has {expected}{wanted}, the device {found}{}", meaning(found))
    }
}

/// Compares a slave with the startup sequence of a gateway: everything that the sequence writes and
/// expects, filters included, but for commands.
///
/// Blocks for one transfer per entry. Filters are read through the editing window of the device,
/// whose index moves; nothing else is written, and the filters in force stay as they are.
///
/// # Errors
/// The first transfer that failed.
pub fn differences(
    bus: &Diagnostics,
    slave: usize,
    steps: &[StartupStep],
) -> Result<Vec<Difference>, Error> {
    // The last write of an entry counts: an assignment is emptied before it is filled.
    let mut last: BTreeMap<(u16, u8), usize> = BTreeMap::new();
    for (at, step) in steps.iter().enumerate() {
        if let StartupStep::Download(write) = step {
            last.insert((write.index, write.subindex), at);
        }
    }
    let mut lists: Vec<FilterList> = Vec::new();
    let mut differences = Vec::new();
    for (at, step) in steps.iter().enumerate() {
        match *step {
            StartupStep::Download(write) if filter_compare::is_of_window(&write) => {
                FilterList::collect(&mut lists, write);
            }
            StartupStep::Download(write) => {
                let is_last = last.get(&(write.index, write.subindex)) == Some(&at);
                if is_last && !is_command(&write) {
                    let found = bus.sdo_upload_u32(slave, write.index, write.subindex)?;
                    if !is_same(&write, found) {
                        differences.push(Difference {
                            index: write.index,
                            subindex: write.subindex,
                            filter: None,
                            expected: Expected::Value(write.value),
                            found,
                            is_set_at_start: matches!(write.index, 0x1C12 | 0x1C13),
                        });
                    }
                }
            }
            StartupStep::Expect { index, subindex, expected } => {
                let found = bus.sdo_upload_u32(slave, index, subindex)?;
                if !expected.is_met_by(found.into()) {
                    differences.push(Difference {
                        index,
                        subindex,
                        filter: None,
                        expected: Expected::Readback(expected),
                        found,
                        is_set_at_start: matches!(index, 0x8010 | 0x8011),
                    });
                }
            }
        }
    }
    for list in lists {
        list.compare(bus, slave, &mut differences)?;
    }
    Ok(differences)
}

/// Whether a device has what was written. The depth of a cache has two numbers (manual 13.2.2).
fn is_same(write: &SdoWrite, found: u32) -> bool {
    let depth = |value| u8::try_from(value).ok().and_then(CacheDepth::from_written);
    let is_depth = (0x8021..=0x8024).contains(&write.index) && write.subindex == 7;
    found == write.value
        || (is_depth && depth(found).is_some() && depth(found) == depth(write.value))
}

/// Whether a write is a command, which reads back as nothing.
fn is_command(write: &SdoWrite) -> bool {
    let apply = object(write.index).and_then(|object| object.apply);
    let entry = object(write.index).and_then(|object| object.entry(write.subindex));
    apply.is_some_and(|apply| apply.command == write.subindex)
        || entry.is_some_and(|entry| !entry.access.can_read())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filter_that_is_not_loaded_is_told_as_such() {
        let subindex = ecan_protocol::config::FilterWindow::STANDARD.status;
        let difference = Difference {
            index: 0x8001,
            subindex,
            filter: Some(3),
            expected: Expected::Loaded,
            found: 1,
            is_set_at_start: false,
        };
        let words = difference.to_string();
        assert!(words.contains(" of filter 3: the device does not load it, 1"), "{words}");
        assert!(words.starts_with("0x8001:"), "{words}");
    }
}
