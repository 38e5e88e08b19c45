//! Configurations as plain data, checked as a whole, turned into SDO downloads
//! (manual 5.4.3, 13.2 to 13.4).

mod assignment;
mod data_path;
mod diagnostic_test;
mod filters;
mod list;
mod mcan_channel;
mod mcan_channel_check;
mod mcan_channel_fields;
mod message_ram;
mod pdo_profile;

pub use assignment::{AssignmentWrites, assignment_writes};
pub use data_path::{
    BusOffRecovery, CacheDepth, CriticalFrames, DATA_PATH_BUDGET_MAX, DATA_PATH_CONFIG_WRITES,
    DATA_PATH_GLOBAL_WRITES, DataPathConfig, DataPathFault, DataPathGlobal, RxBudget, RxOverflow,
    TxOverflow,
};
pub use diagnostic_test::{
    CrcTest, DIAGNOSTIC_TEST_KEY, DIAGNOSTIC_TEST_WRITES, DiagnosticFault, DiagnosticTest,
    RxBypass, Sides, TxBypass,
};
pub use filters::{
    ExtendedFilter, ExtendedMatch, FilterAction, FilterCommand, FilterCommandStatus,
    FilterElementFault, FilterFault, FilterWindow, StandardFilter, StandardMatch, check_filters,
    filter_writes,
};
pub use list::{List, ListFull};
pub use mcan_channel::{
    ApplyStatus, BitTimingMode, McanChannelConfig, NodeMode, NonMatch, SamplePointWindow,
};
pub use mcan_channel_check::ChannelFault;
pub use mcan_channel_fields::{
    InvalidValue, MCAN_CHANNEL_BRING_UP_WRITES, MCAN_CHANNEL_CONFIG_WRITES,
};
pub use message_ram::{
    DataSize, EXTENDED_FILTERS_MAX, FifoMode, MESSAGE_RAM_BYTES, MessageRamLayout, RxFifo,
    STANDARD_FILTERS_MAX, TxMode,
};
pub use pdo_profile::{
    PDO_PROFILE_WRITES, ProfileMismatch, ProfileReadback, ProfileStatus, SessionCommand,
    session_command_write,
};

use core::fmt;

/// Writes a number with its meaning, for the statuses that a device may extend.
fn write_status(f: &mut fmt::Formatter<'_>, raw: u8, known: Option<&'static str>) -> fmt::Result {
    write!(f, "{raw} ({})", known.unwrap_or("not in the manual"))
}
