//! Comparison of a device with a startup sequence, entry by entry.

use std::collections::BTreeMap;

use ecan_host::{Diagnostics, Error, StartupStep};
use ecan_protocol::config::CacheDepth;
use ecan_protocol::object::{SdoWrite, object};

use crate::config_file::difference::{Difference, Expected};
use crate::config_file::filter_compare::{self, FilterList};

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
            StartupStep::Download(write) if filter_compare::is_of_window(&write) => {
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
