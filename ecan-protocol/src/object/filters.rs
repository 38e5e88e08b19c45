//! Acceptance filters of a channel, and the downloads that write them (manual 13.4,
//! "Filter editing window").

use core::iter;

use super::filter_window::{
    ExtendedMatch, FilterAction, FilterCommand, FilterWindow, StandardMatch,
};
use super::mcan_channel::{MCAN_CHANNEL, McanChannelConfig};
use super::message_ram::{EXTENDED_FILTERS_MAX, STANDARD_FILTERS_MAX};
use super::{ObjectType, SdoWrite};

/// An acceptance filter: a [`StandardFilter`] or an [`ExtendedFilter`]. Disabled by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Filter<M, I> {
    /// CAN IDs that match.
    pub matching: M,
    /// Action on the frame.
    pub action: FilterAction,
    /// Mark the frame as a sync message for the timestamp unit.
    pub sync: bool,
    /// First CAN ID, 0..0x7FF or 0..0x1FFFFFFF.
    pub id1: I,
    /// Second CAN ID or mask, of the same range.
    pub id2: I,
}

/// A filter for standard CAN IDs.
pub type StandardFilter = Filter<StandardMatch, u16>;
/// A filter for extended CAN IDs.
pub type ExtendedFilter = Filter<ExtendedMatch, u32>;

/// One of the two kinds of CAN IDs that match.
pub(crate) trait Matching: Copy {
    const WINDOW: FilterWindow;
    const MAX_FILTERS: u8;
    const MAX_ID: u32;
    const IS_EXTENDED: bool;
    fn number(self) -> u8;
    fn is_range(self) -> bool;
}

impl Matching for StandardMatch {
    const WINDOW: FilterWindow = FilterWindow::STANDARD;
    const MAX_FILTERS: u8 = STANDARD_FILTERS_MAX;
    const MAX_ID: u32 = 0x7FF;
    const IS_EXTENDED: bool = false;

    fn number(self) -> u8 {
        self.raw()
    }

    fn is_range(self) -> bool {
        self == Self::Range
    }
}

impl Matching for ExtendedMatch {
    const WINDOW: FilterWindow = FilterWindow::EXTENDED;
    const MAX_FILTERS: u8 = EXTENDED_FILTERS_MAX;
    const MAX_ID: u32 = 0x1FFF_FFFF;
    const IS_EXTENDED: bool = true;

    fn number(self) -> u8 {
        self.raw()
    }

    fn is_range(self) -> bool {
        matches!(self, Self::Range | Self::RangeUnmasked)
    }
}

/// Returns the downloads that write these filters to a channel (0 to 3), in the order of the manual:
/// for each kind the count, then per filter the index, its five fields and the save command. The
/// channel uses them after its apply command. Empty lists write a count of 0.
///
/// Check the lists with [`check_filters`] first; filters beyond the device's lists are omitted.
pub fn filter_writes<'a>(
    channel: u8,
    standard: &'a [StandardFilter],
    extended: &'a [ExtendedFilter],
) -> impl Iterator<Item = SdoWrite> + 'a {
    window_writes(channel, standard).chain(window_writes(channel, extended))
}

fn window_writes<M: Matching, I: Copy + Into<u32>>(
    channel: u8,
    filters: &[Filter<M, I>],
) -> impl Iterator<Item = SdoWrite> + '_ {
    let object = MCAN_CHANNEL.first + u16::from(channel);
    let byte =
        move |subindex, value: u8| SdoWrite::new(object, subindex, ObjectType::U8, value.into());
    let word = move |subindex, value| SdoWrite::new(object, subindex, ObjectType::U32, value);
    let filters = filters.get(..usize::from(M::MAX_FILTERS)).unwrap_or(filters);
    let (window, first) = (M::WINDOW, M::WINDOW.first_field);
    // infallible: the lists are at most 64 long
    iter::once(byte(window.count, filters.len() as u8)).chain((0u8..).zip(filters).flat_map(
        move |(at, filter)| {
            let id2 = match filter.action {
                FilterAction::RxBuffer(buffer) => buffer.into(),
                _ => filter.id2.into(),
            };
            [
                byte(window.index, at),
                byte(first, filter.matching.number()),
                byte(first + 1, filter.action.raw()),
                byte(first + 2, filter.sync.into()),
                word(first + 3, filter.id1.into()),
                word(first + 4, id2),
                byte(window.command, FilterCommand::Save.raw()),
            ]
        },
    ))
}

/// A fault of a filter list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FilterFault {
    /// More filters than the device has elements for.
    #[error("{count} {} filters; allowed: at most {max}", kind(*.extended))]
    TooMany {
        /// True for extended CAN IDs.
        extended: bool,
        /// Filters in the list.
        count: usize,
        /// Filter elements of the device.
        max: u8,
    },
    /// A fault of one filter.
    #[error("{} filter {at}: {fault}", kind(*.extended))]
    Element {
        /// True for extended CAN IDs.
        extended: bool,
        /// Index in the list.
        at: usize,
        /// The fault.
        fault: FilterElementFault,
    },
}

/// A fault of one filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FilterElementFault {
    /// A CAN ID or mask that is too wide.
    #[error("CAN ID 0x{id:X} is out of range; allowed: 0 to 0x{max:X}")]
    Identifier {
        /// The CAN ID.
        id: u32,
        /// Largest allowed value.
        max: u32,
    },
    /// A range that ends before it starts.
    #[error("range 0x{id1:X}..0x{id2:X} is empty")]
    EmptyRange {
        /// First CAN ID.
        id1: u32,
        /// Last CAN ID.
        id2: u32,
    },
    /// A receive buffer that the RAM layout does not have.
    #[error("RX buffer {buffer} does not exist; the layout has {count}")]
    NoBuffer {
        /// The buffer, counted from 0.
        buffer: u8,
        /// Number of buffers of the layout.
        count: u8,
    },
    /// A FIFO that the RAM layout gives no elements.
    #[error("RX FIFO{fifo} has no elements")]
    NoFifo {
        /// The FIFO.
        fifo: u8,
    },
}

fn kind(extended: bool) -> &'static str {
    if extended { "extended" } else { "standard" }
}

/// Reports every fault of a channel's filters, given the channel's configuration.
pub fn check_filters(
    config: &McanChannelConfig,
    standard: &[StandardFilter],
    extended: &[ExtendedFilter],
    report: &mut dyn FnMut(FilterFault),
) {
    check_list(config, standard, report);
    check_list(config, extended, report);
}

fn check_list<M: Matching, I: Copy + Into<u32>>(
    config: &McanChannelConfig,
    filters: &[Filter<M, I>],
    report: &mut dyn FnMut(FilterFault),
) {
    let (extended, count, max) = (M::IS_EXTENDED, filters.len(), M::MAX_FILTERS);
    if count > usize::from(max) {
        report(FilterFault::TooMany { extended, count, max });
    }
    for (at, filter) in filters.iter().enumerate() {
        filter.check(config, &mut |fault| report(FilterFault::Element { extended, at, fault }));
    }
}

#[allow(private_bounds, reason = "there are no other kinds of CAN IDs")]
impl<M: Matching, I: Copy + Into<u32>> Filter<M, I> {
    /// Reports every fault of the filter, given its channel's configuration.
    pub fn check(&self, config: &McanChannelConfig, report: &mut dyn FnMut(FilterElementFault)) {
        let (id1, id2, action, max) = (self.id1.into(), self.id2.into(), self.action, M::MAX_ID);
        // A single CAN ID is in both fields.
        for id in [Some(id1), Some(id2).filter(|id2| *id2 != id1)].into_iter().flatten() {
            if id > max {
                report(FilterElementFault::Identifier { id, max });
            }
        }
        let ram = &config.ram;
        let no_fifo = |fifo, size: u8| (size == 0).then_some(FilterElementFault::NoFifo { fifo });
        let fault = match action {
            FilterAction::RxBuffer(buffer) => {
                let count = ram.rx_buffer_count;
                (buffer >= count).then_some(FilterElementFault::NoBuffer { buffer, count })
            }
            FilterAction::Fifo0 | FilterAction::PriorityFifo0 => no_fifo(0, ram.rx_fifo0.size),
            FilterAction::Fifo1 | FilterAction::PriorityFifo1 => no_fifo(1, ram.rx_fifo1.size),
            FilterAction::Disabled | FilterAction::Reject | FilterAction::Priority => None,
        };
        if let Some(fault) = fault {
            report(fault);
        }
        let to_buffer = matches!(action, FilterAction::RxBuffer(_));
        if self.matching.is_range() && !to_buffer && id1 > id2 {
            report(FilterElementFault::EmptyRange { id1, id2 });
        }
    }
}
