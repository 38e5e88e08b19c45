//! Text of filters.

use ecan_protocol::config::{ExtendedMatch, FilterAction, NonMatch, StandardMatch};

use super::channel_filters::{Kind, RawFilter};

pub(super) fn identifiers(kind: Kind, filter: &RawFilter) -> String {
    let RawFilter { id1, id2, .. } = *filter;
    let digits = if kind == Kind::Standard { 3 } else { 8 };
    let id = |id| format!("0x{id:0digits$X}");
    if matches!(decode_action(filter), Some(FilterAction::RxBuffer(_))) {
        return id(id1);
    }
    let raw = u8::try_from(filter.matching).unwrap_or(u8::MAX);
    let range = || format!("{} to {}", id(id1), id(id2));
    let two = || match id1 == id2 {
        true => id(id1),
        false => format!("{} and {}", id(id1), id(id2)),
    };
    let masked = || format!("{} in the bits of {}", id(id1), id(id2));
    let unknown = || format!("unknown type {}", filter.matching);
    match kind {
        Kind::Standard => match StandardMatch::from_raw(raw) {
            Some(StandardMatch::Range) => range(),
            Some(StandardMatch::Two) => two(),
            Some(StandardMatch::Masked) => masked(),
            Some(StandardMatch::Disabled) => "none".to_owned(),
            None => unknown(),
        },
        Kind::Extended => match ExtendedMatch::from_raw(raw) {
            Some(ExtendedMatch::Range) => range(),
            Some(ExtendedMatch::Two) => two(),
            Some(ExtendedMatch::Masked) => masked(),
            Some(ExtendedMatch::RangeUnmasked) => format!("{}, without global mask", range()),
            None => unknown(),
        },
    }
}

fn decode_action(filter: &RawFilter) -> Option<FilterAction> {
    FilterAction::from_raw(u8::try_from(filter.action).ok()?, filter.id2)
}

pub(super) fn action(filter: &RawFilter) -> String {
    match decode_action(filter) {
        Some(FilterAction::Disabled) => "disabled".to_owned(),
        Some(FilterAction::Fifo0) => "RX FIFO0".to_owned(),
        Some(FilterAction::Fifo1) => "RX FIFO1".to_owned(),
        Some(FilterAction::Reject) => "rejected".to_owned(),
        Some(FilterAction::Priority) => "priority mark".to_owned(),
        Some(FilterAction::PriorityFifo0) => "RX FIFO0, priority mark".to_owned(),
        Some(FilterAction::PriorityFifo1) => "RX FIFO1, priority mark".to_owned(),
        Some(FilterAction::RxBuffer(buffer)) => format!("RX buffer {buffer}"),
        None => format!("unknown action {}", filter.action),
    }
}

pub(super) fn non_match(raw: u32) -> &'static str {
    match u8::try_from(raw).ok().and_then(NonMatch::from_raw) {
        Some(NonMatch::Fifo0) => "RX FIFO0",
        Some(NonMatch::Fifo1) => "RX FIFO1",
        Some(NonMatch::Reject | NonMatch::RejectToo) => "rejected",
        None => "unknown",
    }
}
