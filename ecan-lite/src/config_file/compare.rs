//! Comparison of a device with a startup sequence, entry by entry.

use std::collections::BTreeMap;
use std::fmt;

use ecan_host::{Diagnostics, Error, Expectation, StartupStep};
use ecan_protocol::config::{CacheDepth, DeviceConfig, FilterCommand, FilterWindow};
use ecan_protocol::object::{SdoWrite, describe, lookup, object};

/// Compares a slave with the startup sequence of a gateway: everything that the sequence writes and
/// expects, with filters, without commands.
///
/// Blocks for one transfer per entry. Filters are read through the editing window of the device,
/// whose index changes; nothing else is written, and the active filters are unchanged.
///
/// # Errors
/// The error of the first transfer that failed. An entry that the device does not have is a difference,
/// unless the startup [assumes](ecan_protocol::device::assumed_value) a value for it.
pub fn differences(
    bus: &Diagnostics,
    slave: usize,
    steps: &[StartupStep],
) -> Result<Vec<Difference>, Error> {
    // The last write of an entry counts: an assignment is cleared before it is written.
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
            StartupStep::Download(write) if is_of_window(&write) => {
                FilterList::collect(&mut lists, write);
            }
            StartupStep::Download(write) => {
                let is_last = last.get(&(write.index, write.subindex)) == Some(&at);
                if is_last && !is_command(&write) {
                    let found = read(bus, slave, (write.index, write.subindex))?;
                    if !found.is_some_and(|found| is_same(&write, found)) {
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
                let found = read(bus, slave, (index, subindex))?;
                if !found.is_some_and(|found| expected.is_met_by(found.into())) {
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
    differences.extend(unstated_rotation(bus, slave, &last)?);
    for list in lists {
        match list.compare(bus, slave, &mut differences) {
            Err(Error::Sdo { index, subindex, .. })
                if is_lacking(bus, slave, (index, subindex)) =>
            {
                let expected = Expected::Loaded;
                let (filter, found, is_set_at_start) = (None, None, false);
                differences.push(Difference {
                    index,
                    subindex,
                    filter,
                    expected,
                    found,
                    is_set_at_start,
                });
            }
            compared => compared?,
        }
    }
    Ok(differences)
}

/// The active pin rotation (manual 13.3), if the sequence writes none: channels of a gateway that is not rotated
/// have the connectors of their numbers.
fn unstated_rotation(
    bus: &Diagnostics,
    slave: usize,
    written: &BTreeMap<(u16, u8), usize>,
) -> Result<Option<Difference>, Error> {
    if written.contains_key(&DeviceConfig::ROTATION) {
        return Ok(None);
    }
    let (index, subindex) = DeviceConfig::ACTIVE_ROTATION;
    let found = read(bus, slave, (index, subindex))?.filter(|rotation| *rotation != 0);
    Ok(found.map(|found| Difference {
        index,
        subindex,
        filter: None,
        expected: Expected::NotStated,
        found: Some(found),
        is_set_at_start: false,
    }))
}

/// The value of an entry; `None` if the device does not have it.
fn read(
    bus: &Diagnostics,
    slave: usize,
    (index, subindex): (u16, u8),
) -> Result<Option<u32>, Error> {
    let value = bus.sdo_upload_u32(slave, index, subindex);
    match Error::or_assumed(value, index, subindex) {
        Err(error) if error.is_missing_object() => Ok(None),
        value => value.map(Some),
    }
}

fn is_lacking(bus: &Diagnostics, slave: usize, entry: (u16, u8)) -> bool {
    matches!(read(bus, slave, entry), Ok(None))
}

/// Entries that steps write and a device does not have, without commands, in the order of the steps.
///
/// Blocks for one transfer per entry.
///
/// # Errors
/// The error of the first transfer that the device did not answer. Other aborts are left to the write.
pub fn missing_entries(
    bus: &Diagnostics,
    slave: usize,
    steps: &[StartupStep],
) -> Result<Vec<(u16, u8)>, Error> {
    let mut entries: Vec<(u16, u8)> = Vec::new();
    let mut missing = Vec::new();
    for step in steps {
        let StartupStep::Download(write) = step else { continue };
        let entry = (write.index, write.subindex);
        if is_command(write) || entries.contains(&entry) {
            continue;
        }
        entries.push(entry);
        match read(bus, slave, entry) {
            Ok(None) => missing.push(entry),
            Err(Error::Sdo { abort_code: Some(_), .. }) | Ok(Some(_)) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(missing)
}

/// True if the device has the written value. A cache depth has two numbers (manual 13.2.2).
fn is_same(write: &SdoWrite, found: u32) -> bool {
    let depth = |value| u8::try_from(value).ok().and_then(CacheDepth::from_written);
    let is_depth = (0x8021..=0x8024).contains(&write.index) && write.subindex == 7;
    found == write.value
        || (is_depth && depth(found).is_some() && depth(found) == depth(write.value))
}

/// True if a write is a command, whose read value has no meaning.
fn is_command(write: &SdoWrite) -> bool {
    let apply = object(write.index).and_then(|object| object.apply);
    let entry = object(write.index).and_then(|object| object.entry(write.subindex));
    apply.is_some_and(|apply| apply.command == write.subindex)
        || entry.is_some_and(|entry| !entry.access.can_read())
}

/// Expected value of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expected {
    /// The value of the file.
    Value(u32),
    /// The condition of a readback.
    Readback(Expectation),
    /// The device loads the filter into the editing window.
    Loaded,
    /// The file leaves the entry as it is, and the device has another value than a new one.
    NotStated,
}

impl fmt::Display for Expected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Value(value) => write!(f, "{value}"),
            Self::Readback(expected) => write!(f, "{expected}"),
            Self::Loaded => f.write_str("loaded"),
            Self::NotStated => f.write_str("no value"),
        }
    }
}

/// An entry in which a device and a file differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Index of the object.
    pub index: u16,
    /// Subindex of the entry; for a filter, in the editing window.
    pub subindex: u8,
    /// Index of the filter in its list, for an entry of a filter.
    pub filter: Option<u8>,
    /// Value of the file.
    pub expected: Expected,
    /// Value of the device; `None` if it does not have the entry.
    pub found: Option<u32>,
    /// True if the master writes the entry at each start: the PDO assignment and the active profile.
    /// The flash does not keep these, so they differ from power-up to the start.
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
            Some(text) => format!(" ({text})"),
            None => String::new(),
        };
        let (expected, found) = (self.expected, self.found);
        let text = match expected {
            Expected::Value(value) => meaning(value),
            Expected::Readback(_) | Expected::Loaded | Expected::NotStated => String::new(),
        };
        match (expected, found) {
            (_, None) => write!(
                f,
                ": the file has {expected}{text}, the device lacks it (assumption H42: older firmware)"
            ),
            (Expected::Loaded, Some(found)) => {
                write!(f, ": the device does not load it, {found}{}", meaning(found))
            }
            (Expected::NotStated, Some(found)) => {
                write!(
                    f,
                    ": the device has {found}, the file no `pin_rotation`; add it to [gateway.system]"
                )
            }
            (_, Some(found)) => {
                write!(f, ": the file has {expected}{text}, the device {found}{}", meaning(found))
            }
        }
    }
}

/// The filters that a file writes to one list of a channel.
#[derive(Debug)]
pub(crate) struct FilterList {
    channel_object: u16,
    window: FilterWindow,
    count: u32,
    /// Index in the list, and the fields as they are written.
    filters: Vec<(u8, Vec<(u8, u32)>)>,
}

fn window_of(write: &SdoWrite) -> Option<FilterWindow> {
    let is_of = |window: &FilterWindow| {
        [window.index, window.command, window.count].contains(&write.subindex)
            || window.fields().contains(&write.subindex)
    };
    let is_channel = (0x8001..=0x8004).contains(&write.index);
    if is_channel { FilterWindow::BOTH.into_iter().find(is_of) } else { None }
}

/// True if a write is to an editing window.
pub(crate) fn is_of_window(write: &SdoWrite) -> bool {
    window_of(write).is_some()
}

impl FilterList {
    /// Adds a write to a window.
    pub(crate) fn collect(lists: &mut Vec<Self>, write: SdoWrite) {
        let Some(window) = window_of(&write) else { return };
        let is_same = |other: &Self| other.channel_object == write.index && other.window == window;
        let at = lists.iter().position(is_same).unwrap_or_else(|| {
            let channel_object = write.index;
            lists.push(Self { channel_object, window, count: 0, filters: Vec::new() });
            lists.len() - 1
        });
        let Some(own) = lists.get_mut(at) else { return };
        if write.subindex == window.count {
            own.count = write.value;
        } else if write.subindex == window.index {
            own.filters.push((write.value as u8, Vec::new()));
        } else if write.subindex != window.command
            && let Some((_, fields)) = own.filters.last_mut()
        {
            fields.push((write.subindex, write.value));
        }
    }

    /// Loads each filter into the window and compares its fields.
    pub(crate) fn compare(
        &self,
        bus: &Diagnostics,
        slave: usize,
        differences: &mut Vec<Difference>,
    ) -> Result<(), Error> {
        let mut push = |filter, subindex, expected, found| {
            let (index, is_set_at_start) = (self.channel_object, false);
            differences.push(Difference {
                index,
                subindex,
                filter,
                expected,
                found: Some(found),
                is_set_at_start,
            });
        };
        let read = |subindex| bus.sdo_upload_u32(slave, self.channel_object, subindex);
        let count = read(self.window.count)?;
        if count != self.count {
            push(None, self.window.count, Expected::Value(self.count), count);
        }
        for (at, fields) in &self.filters {
            if u32::from(*at) >= count {
                continue;
            }
            let load = FilterCommand::Load.raw();
            bus.sdo_download(slave, self.channel_object, self.window.index, &[*at])?;
            bus.sdo_download(slave, self.channel_object, self.window.command, &[load])?;
            let status = read(self.window.status)?;
            if status != 0 {
                // The window shows another filter.
                push(Some(*at), self.window.status, Expected::Loaded, status);
                continue;
            }
            for (subindex, expected) in fields {
                let found = read(*subindex)?;
                if found != *expected {
                    push(Some(*at), *subindex, Expected::Value(*expected), found);
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filter_that_is_not_loaded_is_reported() {
        let subindex = ecan_protocol::config::FilterWindow::STANDARD.status;
        let difference = Difference {
            index: 0x8001,
            subindex,
            filter: Some(3),
            expected: Expected::Loaded,
            found: Some(1),
            is_set_at_start: false,
        };
        let text = difference.to_string();
        assert!(text.contains(" of filter 3: the device does not load it, 1"), "{text}");
        assert!(text.starts_with("0x8001:"), "{text}");
    }
}
