//! Configurations as plain data, checked as a whole, converted to SDO downloads
//! (manual 5.4.3, 13.2 to 13.4).

mod assignment;
mod data_path;
mod diagnostic_test;
mod filters;
mod list;
#[cfg(feature = "serde")]
mod list_serde;
mod mcan_channel;
mod mcan_channel_check;
mod mcan_channel_warning;
mod pdo_profile;

pub use crate::object::data_path::{
    BusOffRecovery, CacheDepth, CriticalFrames, DATA_PATH_BUDGET_MAX, DataPathConfig,
    DataPathGlobal, RxBudget, RxOverflow, TxOverflow,
};
pub use crate::object::diagnostic_test::{
    CrcTest, DIAGNOSTIC_TEST_KEY, DiagnosticTest, RxBypass, Sides, TxBypass,
};
pub use crate::object::filter_window::{
    ExtendedMatch, FilterAction, FilterCommand, FilterCommandStatus, FilterWindow, StandardMatch,
};
pub use crate::object::mcan_channel::{
    ApplyStatus, BitTimingMode, McanChannelConfig, NodeMode, NonMatch, SamplePointWindow,
};
pub use crate::object::message_ram::{
    DataSize, EXTENDED_FILTERS_MAX, FifoMode, MESSAGE_RAM_BYTES, MessageRamLayout, RxFifo,
    STANDARD_FILTERS_MAX, TxMode,
};
pub use crate::object::pdo_profile::ProfileStatus;
pub use crate::object::{ConfigObject, InvalidValue, RangeFault};
pub use assignment::{AssignmentWrites, assignment_writes};
pub use data_path::DataPathFault;
pub use diagnostic_test::DiagnosticFault;
pub use filters::{
    ExtendedFilter, Filter, FilterElementFault, FilterFault, StandardFilter, check_filters,
    filter_writes,
};
pub use list::{List, ListFull};
pub use mcan_channel_check::ChannelFault;
pub use mcan_channel_warning::ChannelWarning;
pub use pdo_profile::{SessionCommand, session_command_write};
