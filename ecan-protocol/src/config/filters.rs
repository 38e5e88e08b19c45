//! Acceptance filters of a channel, and the downloads that write them (manual 13.4,
//! "Filter editing window").

use core::iter;

use crate::object::filter_window::{
    ExtendedMatch, FilterAction, FilterCommand, FilterWindow, StandardMatch,
};
use crate::object::mcan_channel::{MCAN_CHANNEL, McanChannelConfig};
use crate::object::message_ram::{EXTENDED_FILTERS_MAX, STANDARD_FILTERS_MAX};
use crate::object::{ObjectType, SdoWrite};

const STANDARD_ID_MAX: u32 = 0x7FF;
const EXTENDED_ID_MAX: u32 = 0x1FFF_FFFF;

/// A filter for standard CAN IDs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StandardFilter {
    /// CAN IDs that match.
    pub matching: StandardMatch,
    /// Action on the frame.
    pub action: FilterAction,
    /// Mark the frame as a sync message for the timestamp unit.
    pub sync: bool,
    /// First CAN ID, 0..0x7FF.
    pub id1: u16,
    /// Second CAN ID or mask, 0..0x7FF.
    pub id2: u16,
}

/// A disabled filter.
impl Default for StandardFilter {
    fn default() -> Self {
        Self {
            matching: StandardMatch::Disabled,
            action: FilterAction::Disabled,
            sync: false,
            id1: 0,
            id2: 0,
        }
    }
}

/// A filter for extended CAN IDs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExtendedFilter {
    /// CAN IDs that match.
    pub matching: ExtendedMatch,
    /// Action on the frame.
    pub action: FilterAction,
    /// Mark the frame as a sync message for the timestamp unit.
    pub sync: bool,
    /// First CAN ID, 0..0x1FFFFFFF.
    pub id1: u32,
    /// Second CAN ID or mask, 0..0x1FFFFFFF.
    pub id2: u32,
}

/// A disabled filter.
impl Default for ExtendedFilter {
    fn default() -> Self {
        Self {
            matching: ExtendedMatch::Range,
            action: FilterAction::Disabled,
            sync: false,
            id1: 0,
            id2: 0,
        }
    }
}

/// A filter with the raw values of the editing window.
#[derive(Clone, Copy)]
struct RawFilter {
    matching: u8,
    action: FilterAction,
    sync: bool,
    id1: u32,
    id2: u32,
    is_range: bool,
}

impl RawFilter {
    fn id2_sent(&self) -> u32 {
        match self.action {
            FilterAction::RxBuffer(buffer) => buffer.into(),
            _ => self.id2,
        }
    }
}

impl From<&StandardFilter> for RawFilter {
    fn from(filter: &StandardFilter) -> Self {
        Self {
            matching: filter.matching.raw(),
            action: filter.action,
            sync: filter.sync,
            id1: filter.id1.into(),
            id2: filter.id2.into(),
            is_range: filter.matching == StandardMatch::Range,
        }
    }
}

impl From<&ExtendedFilter> for RawFilter {
    fn from(filter: &ExtendedFilter) -> Self {
        Self {
            matching: filter.matching.raw(),
            action: filter.action,
            sync: filter.sync,
            id1: filter.id1,
            id2: filter.id2,
            is_range: matches!(
                filter.matching,
                ExtendedMatch::Range | ExtendedMatch::RangeUnmasked
            ),
        }
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
    let standard = standard.get(..usize::from(STANDARD_FILTERS_MAX)).unwrap_or(standard);
    let extended = extended.get(..usize::from(EXTENDED_FILTERS_MAX)).unwrap_or(extended);
    window_writes(
        channel,
        FilterWindow::STANDARD,
        standard.iter().map(RawFilter::from),
        standard.len(),
    )
    .chain(window_writes(
        channel,
        FilterWindow::EXTENDED,
        extended.iter().map(RawFilter::from),
        extended.len(),
    ))
}

fn window_writes<'a>(
    channel: u8,
    window: FilterWindow,
    filters: impl Iterator<Item = RawFilter> + 'a,
    count: usize,
) -> impl Iterator<Item = SdoWrite> + 'a {
    let object = MCAN_CHANNEL.first + u16::from(channel);
    let byte =
        move |subindex, value: u8| SdoWrite::new(object, subindex, ObjectType::U8, value.into());
    let word = move |subindex, value| SdoWrite::new(object, subindex, ObjectType::U32, value);
    let first = window.first_field;
    // infallible: the lists are at most 64 long
    iter::once(byte(window.count, count as u8)).chain((0u8..).zip(filters).flat_map(
        move |(at, filter)| {
            [
                byte(window.index, at),
                byte(first, filter.matching),
                byte(first + 1, filter.action.raw()),
                byte(first + 2, filter.sync.into()),
                word(first + 3, filter.id1),
                word(first + 4, filter.id2_sent()),
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
    check_count(false, standard.len(), STANDARD_FILTERS_MAX, report);
    for (at, filter) in standard.iter().enumerate() {
        let extended = false;
        filter.check(config, &mut |fault| report(FilterFault::Element { extended, at, fault }));
    }
    check_count(true, extended.len(), EXTENDED_FILTERS_MAX, report);
    for (at, filter) in extended.iter().enumerate() {
        let extended = true;
        filter.check(config, &mut |fault| report(FilterFault::Element { extended, at, fault }));
    }
}

fn check_count(extended: bool, count: usize, max: u8, report: &mut dyn FnMut(FilterFault)) {
    if count > usize::from(max) {
        report(FilterFault::TooMany { extended, count, max });
    }
}

impl StandardFilter {
    /// Reports every fault of the filter, given its channel's configuration.
    pub fn check(&self, config: &McanChannelConfig, report: &mut dyn FnMut(FilterElementFault)) {
        RawFilter::from(self).check(config, STANDARD_ID_MAX, report);
    }
}

impl ExtendedFilter {
    /// Reports every fault of the filter, given its channel's configuration.
    pub fn check(&self, config: &McanChannelConfig, report: &mut dyn FnMut(FilterElementFault)) {
        RawFilter::from(self).check(config, EXTENDED_ID_MAX, report);
    }
}

impl RawFilter {
    fn check(
        &self,
        config: &McanChannelConfig,
        max: u32,
        report: &mut dyn FnMut(FilterElementFault),
    ) {
        let Self { id1, id2, action, .. } = *self;
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
        if self.is_range && !to_buffer && id1 > id2 {
            report(FilterElementFault::EmptyRange { id1, id2 });
        }
    }
}
