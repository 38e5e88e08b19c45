//! Acceptance filters, filled by the editing window of 0x8001..0x8004, and receive FIFOs in the Message RAM (manual
//! 13.4).

use std::collections::VecDeque;

use ecan_protocol::can::CanFrame;
use ecan_protocol::config::{ExtendedMatch, FifoMode, FilterAction, NonMatch, StandardMatch};

use crate::event_queue::take_first;

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

/// Largest size of a receive FIFO, and largest number of receive buffers.
pub(super) const RX_ELEMENTS_MAX: usize = 64;

#[derive(Clone, Copy, Debug)]
pub(super) struct Received {
    pub(super) frame: CanFrame,
    /// End of the frame on the bus, or its start if the TSU captures that.
    pub(super) at_ns: u64,
    /// ID_AUX of the packet: 0 FIFO0, 1 FIFO1, 2 RX buffer, 3 high priority (manual 8.1).
    pub(super) source: u8,
}

#[derive(Clone, Debug, Default)]
pub(super) struct ReceiveFifo {
    elements: VecDeque<Received>,
    get_index: u32,
    put_index: u32,
    lost: bool,
}

impl ReceiveFifo {
    pub(super) fn new() -> Self {
        Self { elements: VecDeque::with_capacity(RX_ELEMENTS_MAX), ..Self::default() }
    }

    pub(super) fn clear(&mut self) -> usize {
        let flushed = self.elements.len();
        self.elements.clear();
        self.get_index = 0;
        self.put_index = 0;
        self.lost = false;
        flushed
    }

    /// Stores a frame; returns `false` if that lost a frame.
    pub(super) fn store(&mut self, received: Received, size: u8, mode: FifoMode) -> bool {
        let size = usize::from(size).min(RX_ELEMENTS_MAX);
        let full = self.elements.len() >= size;
        if full {
            self.lost = true;
            if size == 0 || mode == FifoMode::Blocking {
                return false;
            }
            self.elements.pop_front();
            self.get_index = wrap_increment(self.get_index, size);
        }
        self.elements.push_back(received);
        self.put_index = wrap_increment(self.put_index, size);
        !full
    }

    pub(super) fn take(&mut self, size: u8) -> Option<Received> {
        let taken = take_first(&mut self.elements)?;
        self.get_index = wrap_increment(self.get_index, usize::from(size));
        self.lost = false;
        Some(taken)
    }

    /// Acknowledges the element at `index` and all before it, read or not; returns their number.
    /// Ignores an index without a frame.
    pub(super) fn acknowledge(&mut self, index: u32, size: u8) -> usize {
        let size = u32::from(size);
        if index >= size {
            return 0;
        }
        let count = (index + size).saturating_sub(self.get_index) % size + 1;
        if count as usize > self.elements.len() {
            return 0;
        }
        self.elements.drain(..count as usize);
        self.get_index = (self.get_index + count) % size;
        self.lost = false;
        count as usize
    }

    pub(super) fn len(&self) -> usize {
        self.elements.len()
    }

    /// Returns whether a frame was lost since the last one was taken.
    pub(super) fn has_lost(&self) -> bool {
        self.lost
    }

    /// RXF0S or RXF1S: fill level, get index, put index, full, message lost.
    pub(super) fn status(&self, size: u8) -> u32 {
        let fill = self.elements.len() as u32;
        fill | self.get_index << 8
            | self.put_index << 16
            | u32::from(size != 0 && fill >= u32::from(size)) << 24
            | u32::from(self.lost) << 25
    }
}

pub(super) fn wrap_increment(index: u32, size: usize) -> u32 {
    match u32::try_from(size) {
        Ok(size) if index + 1 < size => index + 1,
        _ => 0,
    }
}
