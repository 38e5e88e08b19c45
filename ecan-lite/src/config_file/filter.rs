//! Acceptance filters of a file (manual 13.4).

use ecan_protocol::config::{
    ConfigObject, ExtendedFilter, ExtendedMatch, FilterAction, FilterWindow, McanChannelConfig,
    StandardFilter, StandardMatch,
};

use crate::config_file::document::Table;
use crate::config_file::fields;

pub(crate) const STANDARD_TABLE: &str = "standard_filter";
pub(crate) const EXTENDED_TABLE: &str = "extended_filter";

/// Numbers of receive buffers.
const BUFFERS: (u32, u32) = (0, 63);

const KEYS: [&str; 5] = ["match", "action", "sync", "id1", "id2"];

pub(crate) fn read_standard(table: &mut Table<'_, '_>) -> Vec<StandardFilter> {
    let tables = table.tables(STANDARD_TABLE);
    let read = |table| {
        let filter = Filter::read(table, FilterWindow::STANDARD);
        StandardFilter {
            matching: filter.matching(StandardMatch::from_raw, StandardMatch::Two),
            action: filter.action,
            sync: filter.sync,
            id1: filter.id1 as u16,
            id2: filter.id2 as u16,
        }
    };
    tables.into_iter().map(read).collect()
}

pub(crate) fn read_extended(table: &mut Table<'_, '_>) -> Vec<ExtendedFilter> {
    let tables = table.tables(EXTENDED_TABLE);
    let read = |table| {
        let filter = Filter::read(table, FilterWindow::EXTENDED);
        ExtendedFilter {
            matching: filter.matching(ExtendedMatch::from_raw, ExtendedMatch::Two),
            action: filter.action,
            sync: filter.sync,
            id1: filter.id1,
            id2: filter.id2,
        }
    };
    tables.into_iter().map(read).collect()
}

struct Filter {
    /// Raw value; `None` for a filter into a receive buffer, whose type the core ignores.
    matching: Option<u32>,
    action: FilterAction,
    sync: bool,
    id1: u32,
    id2: u32,
}

impl Filter {
    fn read(mut table: Table<'_, '_>, window: FilterWindow) -> Self {
        let mut fields = window.fields().zip(KEYS).map(|(subindex, key)| {
            let entry = (McanChannelConfig::INDEX, subindex);
            fields::read_entry(&mut table, key, entry)
        });
        let [matching, action, sync, id1, id2] = std::array::from_fn(|_| fields.next().flatten());
        drop(fields);
        let buffer_action = u32::from(FilterAction::RxBuffer(0).raw());
        let is_buffer = action == Some(buffer_action);
        // A filter into a receive buffer matches the one CAN ID `id1`.
        let needed: &[&str] = match is_buffer || table.is_recorded() {
            true => &["action", "id1"],
            false => &["action", "match", "id1", "id2"],
        };
        for key in needed.iter().filter(|key| !table.has(key)) {
            table.fault(key, format!("`{key}` is missing"));
        }
        let mut buffer = 0;
        if table.is_recorded() {
            table.unsigned::<u8>("rx_buffer", BUFFERS);
        }
        if is_buffer {
            for key in ["match", "id2"].into_iter().filter(|key| table.has(key)) {
                let why = "a filter into a receive buffer matches the one CAN ID `id1`";
                table.fault(key, format!("`{key}` has no effect: {why}"));
            }
            buffer = table.unsigned("rx_buffer", BUFFERS).unwrap_or(0);
            if !table.has("rx_buffer") {
                table.fault("rx_buffer", "`rx_buffer` is missing: the buffer's number");
            }
        }
        let action = action.and_then(|raw| FilterAction::from_raw(raw as u8, buffer));
        Self {
            matching,
            action: action.unwrap_or(FilterAction::Disabled),
            sync: sync == Some(1),
            id1: id1.unwrap_or(0),
            id2: id2.or(id1).unwrap_or(0),
        }
    }

    /// The type of the filter. `two` for a receive buffer: no firmware can interpret it as a filter
    /// that is not used.
    fn matching<M>(&self, from_raw: fn(u8) -> Option<M>, two: M) -> M {
        self.matching.and_then(|raw| from_raw(raw as u8)).unwrap_or(two)
    }
}
