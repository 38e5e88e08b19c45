//! Configurations as plain data, checked as a whole, converted to SDO downloads
//! (manual 5.4.3, 13.2 to 13.4).

mod list;

pub use crate::object::communication::{AssignmentWrites, assignment_writes};
pub use crate::object::data_path::{
    BusOffRecovery, CacheDepth, CriticalFrames, DATA_PATH_BUDGET_MAX, DataPathConfig,
    DataPathFault, DataPathGlobal, RxBudget, RxOverflow, TxOverflow,
};
pub use crate::object::diagnostic_test::{
    CrcTest, DIAGNOSTIC_TEST_KEY, DiagnosticFault, DiagnosticTest, RxBypass, Sides, TxBypass,
};
pub use crate::object::filter_window::{
    ExtendedMatch, FilterAction, FilterCommand, FilterCommandStatus, FilterWindow, StandardMatch,
};
pub use crate::object::filters::{
    ExtendedFilter, Filter, FilterElementFault, FilterFault, StandardFilter, check_filters,
    filter_writes,
};
pub use crate::object::mcan_channel::{
    ApplyStatus, BitTimingMode, McanChannelConfig, NodeMode, NonMatch, SamplePointWindow,
};
pub use crate::object::mcan_channel_check::{ChannelFault, ChannelWarning};
pub use crate::object::message_ram::{
    DataSize, EXTENDED_FILTERS_MAX, FifoMode, MESSAGE_RAM_BYTES, MessageRamLayout, RxFifo,
    STANDARD_FILTERS_MAX, TxMode,
};
pub use crate::object::pdo_profile::{ProfileStatus, SessionCommand, session_command_write};
pub use crate::object::{ConfigObject, InvalidValue, RangeFault};
pub use list::{List, ListFull};
