//! Acceptance filters of a file (manual 13.4).

use ecan_protocol::config::{
    ExtendedFilter, ExtendedMatch, FilterAction, StandardFilter, StandardMatch,
};

use crate::document::{Document, Table};

pub(crate) const STANDARD_TABLE: &str = "standard_filter";
pub(crate) const EXTENDED_TABLE: &str = "extended_filter";

const ACTIONS: [(&str, FilterAction); 8] = [
    ("disabled", FilterAction::Disabled),
    ("fifo0", FilterAction::Fifo0),
    ("fifo1", FilterAction::Fifo1),
    ("reject", FilterAction::Reject),
    ("priority", FilterAction::Priority),
    ("priority_fifo0", FilterAction::PriorityFifo0),
    ("priority_fifo1", FilterAction::PriorityFifo1),
    ("rx_buffer", FilterAction::RxBuffer(0)),
];
const STANDARD_MATCHES: [(&str, StandardMatch); 4] = [
    ("range", StandardMatch::Range),
    ("two", StandardMatch::Two),
    ("masked", StandardMatch::Masked),
    ("disabled", StandardMatch::Disabled),
];
const EXTENDED_MATCHES: [(&str, ExtendedMatch); 4] = [
    ("range", ExtendedMatch::Range),
    ("two", ExtendedMatch::Two),
    ("masked", ExtendedMatch::Masked),
    ("range_unmasked", ExtendedMatch::RangeUnmasked),
];

pub(crate) fn read_standard(
    document: &mut Document<'_>,
    table: &mut Table<'_, '_>,
) -> Vec<StandardFilter> {
    let tables = table.tables(document, STANDARD_TABLE);
    let read = |table| {
        let fields = Fields::read(document, table, &STANDARD_MATCHES, 0x7FF);
        StandardFilter {
            matching: fields.matching.unwrap_or(StandardMatch::Two),
            action: fields.action,
            sync: fields.sync,
            id1: fields.id1 as u16,
            id2: fields.id2 as u16,
        }
    };
    tables.into_iter().map(read).collect()
}

pub(crate) fn read_extended(
    document: &mut Document<'_>,
    table: &mut Table<'_, '_>,
) -> Vec<ExtendedFilter> {
    let tables = table.tables(document, EXTENDED_TABLE);
    let read = |table| {
        let fields = Fields::read(document, table, &EXTENDED_MATCHES, 0x1FFF_FFFF);
        ExtendedFilter {
            matching: fields.matching.unwrap_or(ExtendedMatch::Two),
            action: fields.action,
            sync: fields.sync,
            id1: fields.id1,
            id2: fields.id2,
        }
    };
    tables.into_iter().map(read).collect()
}

struct Fields<M> {
    /// None of a filter into a receive buffer: the core ignores it then. It is written as `two`, which
    /// no firmware can take for a filter that is out of use.
    matching: Option<M>,
    action: FilterAction,
    sync: bool,
    id1: u32,
    id2: u32,
}

impl<M: Copy> Fields<M> {
    fn read(
        document: &mut Document<'_>,
        mut table: Table<'_, '_>,
        matches: &[(&str, M)],
        greatest: u32,
    ) -> Self {
        let action = table.word(document, "action", &ACTIONS);
        let is_buffer = matches!(action, Some(FilterAction::RxBuffer(_)));
        let matching = table.word(document, "match", matches);
        let id1 = table.unsigned(document, "id1", (0, greatest));
        let id2 = table.unsigned(document, "id2", (0, greatest));
        // A filter into a buffer means the one identifier `id1`.
        let needed: &[&str] = match is_buffer {
            true => &["action", "id1"],
            false => &["action", "match", "id1", "id2"],
        };
        for key in needed {
            if !table.has(key) {
                table.fault(document, key, format!("`{key}` is missing"));
            }
        }
        let mut action = action.unwrap_or(FilterAction::Disabled);
        if is_buffer {
            for key in ["match", "id2"].into_iter().filter(|key| table.has(key)) {
                let why = "a filter into a receive buffer means the one identifier `id1`";
                table.fault(document, key, format!("`{key}` has no effect: {why}"));
            }
            let buffer = table.unsigned(document, "rx_buffer", (0, 63));
            if !table.has("rx_buffer") {
                table.fault(document, "rx_buffer", "`rx_buffer` is missing: the buffer's number");
            }
            action = FilterAction::RxBuffer(buffer.unwrap_or(0) as u8);
        }
        let sync = table.flag(document, "sync").unwrap_or(false);
        table.finish(document);
        let (id1, id2) = (id1.unwrap_or(0), id2.or(id1).unwrap_or(0));
        Self { matching, action, sync, id1, id2 }
    }
}
