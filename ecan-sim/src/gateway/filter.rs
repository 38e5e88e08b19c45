//! Acceptance filters of an MCAN controller, filled by the editing window of 0x8001..0x8004 (manual
//! 13.4).

use ecan_protocol::can::CanFrame;
use ecan_protocol::config::{ExtendedMatch, FilterAction, NonMatch, StandardMatch};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Destination {
    Fifo0,
    Fifo1,
    Buffer(u8),
    Nowhere,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FilterResult {
    pub(super) destination: Destination,
    /// A filter marked the frame as high priority.
    pub(super) priority: bool,
    pub(super) filter: Option<u8>,
}

/// One filter element, in the values of the editing window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct FilterElement {
    pub(super) kind: u8,
    pub(super) action: u8,
    pub(super) sync: u8,
    pub(super) id1: u32,
    pub(super) id2: u32,
}

impl FilterElement {
    /// The action; undefined numbers are "disabled".
    fn action(&self) -> FilterAction {
        FilterAction::from_raw(self.action, self.id2).unwrap_or(FilterAction::Disabled)
    }

    /// Returns whether the element matches a frame: `id` as received, `masked` after the global mask.
    fn matches(&self, id: u32, masked: u32, extended: bool) -> bool {
        match self.action() {
            FilterAction::Disabled => return false,
            // the second identifier selects the buffer; the kind of match is ignored
            FilterAction::RxBuffer(_) => return masked == self.id1,
            _ => {}
        }
        let range = |id| (self.id1..=self.id2).contains(&id);
        let two = || masked == self.id1 || masked == self.id2;
        let mask = || masked & self.id2 == self.id1 & self.id2;
        if extended {
            match ExtendedMatch::from_raw(self.kind) {
                Some(ExtendedMatch::Range) => range(masked),
                Some(ExtendedMatch::Two) => two(),
                Some(ExtendedMatch::Masked) => mask(),
                Some(ExtendedMatch::RangeUnmasked) => range(id),
                None => false,
            }
        } else {
            match StandardMatch::from_raw(self.kind) {
                Some(StandardMatch::Range) => range(masked),
                Some(StandardMatch::Two) => two(),
                Some(StandardMatch::Masked) => mask(),
                Some(StandardMatch::Disabled) | None => false,
            }
        }
    }

    fn result(&self, number: u8) -> FilterResult {
        let (destination, priority) = match self.action() {
            FilterAction::Fifo0 => (Destination::Fifo0, false),
            FilterAction::Fifo1 => (Destination::Fifo1, false),
            FilterAction::PriorityFifo0 => (Destination::Fifo0, true),
            FilterAction::PriorityFifo1 => (Destination::Fifo1, true),
            FilterAction::RxBuffer(buffer) => (Destination::Buffer(buffer), false),
            // the core stops at the first match: a priority mark alone stores nothing
            FilterAction::Priority => (Destination::Nowhere, true),
            FilterAction::Disabled | FilterAction::Reject => (Destination::Nowhere, false),
        };
        FilterResult { destination, priority, filter: Some(number) }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct FilterTable {
    pub(super) standard: Vec<FilterElement>,
    pub(super) extended: Vec<FilterElement>,
    pub(super) non_match_standard: NonMatch,
    pub(super) non_match_extended: NonMatch,
    pub(super) reject_remote_standard: bool,
    pub(super) reject_remote_extended: bool,
    pub(super) extended_mask: u32,
}

impl FilterTable {
    /// Filters a frame: remote rule first, then the list in order, then the non-match rule.
    pub(super) fn evaluate(&self, frame: &CanFrame) -> FilterResult {
        let id = frame.id();
        let extended = id.is_extended();
        let (list, non_match, reject_remote) = if extended {
            (&self.extended, self.non_match_extended, self.reject_remote_extended)
        } else {
            (&self.standard, self.non_match_standard, self.reject_remote_standard)
        };
        if frame.is_remote() && reject_remote {
            return REJECTED;
        }
        let masked = if extended { id.raw() & self.extended_mask } else { id.raw() };
        let hit =
            list.iter().zip(0u8..).find(|(element, _)| element.matches(id.raw(), masked, extended));
        if let Some((element, number)) = hit {
            return element.result(number);
        }
        let destination = match non_match {
            NonMatch::Fifo0 => Destination::Fifo0,
            NonMatch::Fifo1 => Destination::Fifo1,
            NonMatch::Reject | NonMatch::RejectToo => Destination::Nowhere,
        };
        FilterResult { destination, priority: false, filter: None }
    }
}

const REJECTED: FilterResult =
    FilterResult { destination: Destination::Nowhere, priority: false, filter: None };
