//! Comparison of the filters of a channel with a file, through the editing windows (manual 13.4).

use ecan_host::{Diagnostics, Error};
use ecan_protocol::config::{FilterCommand, FilterWindow};
use ecan_protocol::object::SdoWrite;

use crate::config_file::difference::{Difference, Expected};

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
        let is_it = |it: &Self| it.channel_object == write.index && it.window == window;
        let at = lists.iter().position(is_it).unwrap_or_else(|| {
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
