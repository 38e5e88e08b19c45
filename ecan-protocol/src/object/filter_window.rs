//! The filter editing windows of 0x8001 to 0x8004 (manual 13.4, "Filter editing window").
//!
//! The manual gives no numbers for filter types and actions; those of the MCAN core's filter
//! elements are used.

use super::value::raw_enum;

/// Action on a frame that matches a filter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum FilterAction {
    /// The filter is not used.
    #[default]
    Disabled,
    /// Store in RX FIFO0.
    Fifo0,
    /// Store in RX FIFO1.
    Fifo1,
    /// Reject.
    Reject,
    /// Mark as a priority message; later filters decide where it is stored.
    Priority,
    /// Mark as a priority message and store in RX FIFO0.
    PriorityFifo0,
    /// Mark as a priority message and store in RX FIFO1.
    PriorityFifo1,
    /// Store in the receive buffer of this number. The filter then matches the one CAN ID `id1`;
    /// its type and second CAN ID are ignored.
    RxBuffer(u8),
}

impl FilterAction {
    pub(super) const VALUES: &[(u32, &str)] = &[
        (0, "disabled"),
        (1, "FIFO0"),
        (2, "FIFO1"),
        (3, "reject"),
        (4, "priority"),
        (5, "priority FIFO0"),
        (6, "priority FIFO1"),
        (7, "RX buffer"),
    ];

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

    /// Returns the action with this number; 7 takes its buffer from the filter's second CAN ID.
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
    /// Standard CAN IDs that match (0x8001:50).
    #[derive(Default)]
    pub enum StandardMatch: u8;
    /// From `id1` to `id2`, both included.
    Range = 0, "range";
    /// `id1` and `id2`.
    Two = 1, "two";
    /// CAN IDs that equal `id1` in the bits set in `id2`.
    Masked = 2, "masked";
    /// None.
    #[default]
    Disabled = 3, "disabled";
}

raw_enum! {
    /// Extended CAN IDs that match (0x8001:56).
    #[derive(Default)]
    pub enum ExtendedMatch: u8;
    /// From `id1` to `id2`, both included, after the global mask 0x8001:40.
    #[default]
    Range = 0, "range";
    /// `id1` and `id2`.
    Two = 1, "two";
    /// CAN IDs that equal `id1` in the bits set in `id2`.
    Masked = 2, "masked";
    /// From `id1` to `id2` without the global mask.
    RangeUnmasked = 3, "range unmasked";
}

raw_enum! {
    /// Command of the filter editing window (0x8001:45, :46).
    pub enum FilterCommand: u8;
    /// Does nothing.
    None = 0, "no-op";
    /// Copies the entry at the current index into the window.
    Load = 1, "load current";
    /// Copies the window into the entry at the current index.
    Save = 2, "save current";
    /// Disables the entry at the current index.
    Clear = 3, "clear current";
    /// Reserved; the flash command of the channel saves all.
    Flash = 4, "flash current";
}

raw_enum! {
    /// Result of a filter command (0x8001:47, :48).
    pub enum FilterCommandStatus: u8;
    Ok = 0, "OK";
    InvalidIndex = 1, "invalid index";
    InvalidCommand = 2, "invalid command";
}

/// Subindices of one of the two filter editing windows of 0x8001..0x8004 (manual 13.4).
///
/// A filter is edited in five steps: write its index to [`index`](Self::index), write
/// [`FilterCommand::Load`] to [`command`](Self::command), read or write the
/// [`fields`](Self::fields), write [`FilterCommand::Save`] to `command`, read
/// [`status`](Self::status). The list has [`count`](Self::count) filters; the channel uses it after
/// its apply command.
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
    /// Number of filters that the device has; read only.
    pub max: u8,
    /// Index in the list, from 0, that a command applies to.
    pub index: u8,
    /// A [`FilterCommand`].
    pub command: u8,
    /// Result of the command, a [`FilterCommandStatus`]; read only.
    pub status: u8,
    /// Number of filters in use, from the first one.
    pub count: u8,
    /// First of the five fields of the filter: type, action, sync, ID1 and ID2 are consecutive.
    pub first_field: u8,
}

impl FilterWindow {
    /// The window of the filters for 11-bit CAN IDs.
    pub const STANDARD: Self =
        Self { max: 41, index: 43, command: 45, status: 47, count: 49, first_field: 50 };
    /// The window of the filters for 29-bit CAN IDs.
    pub const EXTENDED: Self =
        Self { max: 42, index: 44, command: 46, status: 48, count: 55, first_field: 56 };
    /// Both windows, that of the standard filters first.
    pub const BOTH: [Self; 2] = [Self::STANDARD, Self::EXTENDED];

    /// Subindices of type, action, sync, ID1 and ID2, in this order.
    pub const fn fields(&self) -> core::ops::Range<u8> {
        self.first_field..self.first_field + 5
    }
}
