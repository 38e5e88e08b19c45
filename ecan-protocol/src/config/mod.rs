//! Configurations as plain data, checked as a whole, converted to SDO downloads
//! (manual 5.4.3, 13.2 to 13.4).

mod list;

pub use crate::object::communication::{AssignmentWrites, assignment_writes};
pub use crate::object::data_path::*;
pub use crate::object::diagnostic_test::*;
pub use crate::object::filter_window::*;
pub use crate::object::filters::*;
pub use crate::object::maintenance::{DeviceConfig, DeviceFault};
pub use crate::object::mcan_channel::*;
pub use crate::object::mcan_channel_check::*;
pub use crate::object::message_ram::*;
pub use crate::object::pdo_profile::{ProfileStatus, SessionCommand, session_command_write};
pub use crate::object::{ConfigObject, InvalidValue, RangeFault};
pub use list::{List, ListFull};
