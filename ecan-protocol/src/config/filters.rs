//! Acceptance filters of a channel and the editing window that writes them (manual 13.4,
//! "Filter editing window").
//!
//! The manual gives no numbers for filter types and actions; those of the MCAN core's filter
//! elements are used.

use core::iter;

use super::mcan_channel::{McanChannelConfig, channel_index};
use super::message_ram::{EXTENDED_FILTERS_MAX, STANDARD_FILTERS_MAX};
use crate::object::ObjectType;
use crate::object::SdoWrite;
use crate::raw_enum::raw_enum;

const STANDARD_ID_MAX: u32 = 0x7FF;
const EXTENDED_ID_MAX: u32 = 0x1FFF_FFFF;

/// What a matching frame is put into, or whether it is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FilterAction {
    /// The filter is out of use.
    Disabled,
    /// Into RX FIFO0.
    Fifo0,
    /// Into RX FIFO1.
    Fifo1,
    /// Refused.
    Reject,
    /// Marked as a priority message; the frame goes where later filters say.
    Priority,
    /// Marked as a priority message, into RX FIFO0.
    PriorityFifo0,
    /// Marked as a priority message, into RX FIFO1.
    PriorityFifo1,
    /// Into the receive buffer of this number. The filter then means the one identifier `id1`;
    /// its kind of match and second identifier are ignored.
    RxBuffer(u8),
}

impl FilterAction {
    /// The number of the core.
    pub const fn raw(self) -> u8 {
        match self {
            Self::Disabled => 0,
            Self::Fifo0 => 1,
            Self::Fifo1 => 2,
            Self::Reject => 3,
            Self::Priority => 4,
            Self::PriorityFifo0 => 5,
            Self::PriorityFifo1 => 6,
            Self::RxBuffer(_) => 7,
        }
    }

    /// The action for the core's number; 7 takes its buffer from the filter's second identifier.
    pub const fn from_raw(raw: u8, id2: u32) -> Option<Self> {
        Some(match raw {
            0 => Self::Disabled,
            1 => Self::Fifo0,
            2 => Self::Fifo1,
            3 => Self::Reject,
            4 => Self::Priority,
            5 => Self::PriorityFifo0,
            6 => Self::PriorityFifo1,
            7 => Self::RxBuffer((id2 & 0x3F) as u8),
            _ => return None,
        })
    }
}

raw_enum! {
    /// Which standard identifiers match (0x8001:50).
    pub enum StandardMatch: u8 {
        /// From `id1` to `id2`, both included.
        Range = 0,
        /// `id1` and `id2`.
        Two = 1,
        /// Those that equal `id1` in the bits set in `id2`.
        Masked = 2,
        /// None.
        Disabled = 3,
    }
}

raw_enum! {
    /// Which extended identifiers match (0x8001:56).
    pub enum ExtendedMatch: u8 {
        /// From `id1` to `id2`, both included, after the global mask 0x8001:40.
        Range = 0,
        /// `id1` and `id2`.
        Two = 1,
        /// Those that equal `id1` in the bits set in `id2`.
        Masked = 2,
        /// From `id1` to `id2` without the global mask.
        RangeUnmasked = 3,
    }
}

raw_enum! {
    /// Command of the filter editing window (0x8001:45, :46).
    pub enum FilterCommand: u8 {
        /// Nothing.
        None = 0,
        /// The entry at the current index into the window.
        Load = 1,
        /// The window into the entry at the current index.
        Save = 2,
        /// The entry at the current index out of use.
        Clear = 3,
        /// Reserved; the channel's flash command saves all.
        Flash = 4,
    }
}

raw_enum! {
    /// Result of a filter command (0x8001:47, :48).
    pub enum FilterCommandStatus: u8 {
        /// Done.
        Ok = 0,
        /// No such index.
        InvalidIndex = 1,
        /// No such command.
        InvalidCommand = 2,
    }
}

/// A filter for standard identifiers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StandardFilter {
    /// Which identifiers match.
    pub matching: StandardMatch,
    /// What happens to the frame.
    pub action: FilterAction,
    /// Mark the frame as a sync message for the timestamp unit.
    pub sync: bool,
    /// First identifier, 0..0x7FF.
    pub id1: u16,
    /// Second identifier or mask, 0..0x7FF.
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

/// A filter for extended identifiers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExtendedFilter {
    /// Which identifiers match.
    pub matching: ExtendedMatch,
    /// What happens to the frame.
    pub action: FilterAction,
    /// Mark the frame as a sync message for the timestamp unit.
    pub sync: bool,
    /// First identifier, 0..0x1FFFFFFF.
    pub id1: u32,
    /// Second identifier or mask, 0..0x1FFFFFFF.
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

/// One filter in the numbers of the editing window.
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

/// Subindices of one of the two filter editing windows of 0x8001..0x8004 (manual 13.4).
///
/// A filter is edited in five steps: its place into [`index`](Self::index), [`FilterCommand::Load`]
/// into [`command`](Self::command), the [`fields`](Self::fields) read or written,
/// [`FilterCommand::Save`] into `command`, and [`status`](Self::status) read. The list is as long as
/// [`count`](Self::count) says; the channel takes it over with its apply command.
///
/// ```
/// use ecan_protocol::config::FilterWindow;
/// use ecan_protocol::object::lookup;
///
/// let window = FilterWindow::STANDARD;
/// let (_, entry) = lookup(0x8001, window.count).unwrap();
/// assert_eq!(entry.name, "Std filter count");
/// assert_eq!(window.fields(), 50..55);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FilterWindow {
    /// How many filters the device has; read only.
    pub max: u8,
    /// Place in the list, from 0, that a command is about.
    pub index: u8,
    /// A [`FilterCommand`].
    pub command: u8,
    /// What became of it: a [`FilterCommandStatus`]; read only.
    pub status: u8,
    /// How many filters of the list are in use, from the first on.
    pub count: u8,
    /// The first of the five fields of the filter: type, action, sync, ID1 and ID2 follow each other.
    pub first_field: u8,
}

impl FilterWindow {
    /// The window of the filters for 11-bit identifiers.
    pub const STANDARD: Self =
        Self { max: 41, index: 43, command: 45, status: 47, count: 49, first_field: 50 };
    /// The window of the filters for 29-bit identifiers.
    pub const EXTENDED: Self =
        Self { max: 42, index: 44, command: 46, status: 48, count: 55, first_field: 56 };
    /// Both, that of the standard filters first.
    pub const BOTH: [Self; 2] = [Self::STANDARD, Self::EXTENDED];

    /// The subindices of type, action, sync, ID1 and ID2, in this order.
    pub const fn fields(&self) -> core::ops::Range<u8> {
        self.first_field..self.first_field + 5
    }
}

/// The downloads that give a channel (0..3) these filters, in the order of the manual: for each
/// kind the count, then per filter the index, its five fields and the save command. The channel
/// takes them over with its apply command. Empty lists write a count of 0.
///
/// Check the lists with [`check_filters`] first; what exceeds the device's lists is left out.
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
    let object = channel_index(channel);
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
    #[error("{count} {} filters, the device has {max}", kind(*.extended))]
    TooMany {
        /// True for extended identifiers.
        extended: bool,
        /// Filters in the list.
        count: usize,
        /// What the device has.
        max: u8,
    },
    /// One of the filters is wrong.
    #[error("{} filter {at}: {fault}", kind(*.extended))]
    Element {
        /// True for extended identifiers.
        extended: bool,
        /// Position in the list.
        at: usize,
        /// What is wrong with it.
        fault: FilterElementFault,
    },
}

/// A fault of one filter, whatever its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FilterElementFault {
    /// An identifier or mask that is too wide.
    #[error("identifier 0x{id:X} is above 0x{max:X}")]
    Identifier {
        /// The identifier.
        id: u32,
        /// The greatest possible.
        max: u32,
    },
    /// A range that ends before it starts.
    #[error("range 0x{id1:X}..0x{id2:X} is empty")]
    EmptyRange {
        /// First identifier.
        id1: u32,
        /// Last identifier.
        id2: u32,
    },
    /// A receive buffer that the RAM layout does not have.
    #[error("RX buffer {buffer} of {count}")]
    NoBuffer {
        /// The buffer, counted from 0.
        buffer: u8,
        /// How many the layout has.
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
        // One identifier alone stands in both places.
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
