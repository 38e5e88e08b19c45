//! Values of CiA 402 objects.

mod controlword;
mod mode;
mod option_code;
mod statusword;

pub use controlword::{Command, Controlword};
pub use mode::{OperatingMode, SupportedModes};
pub use option_code::{FaultReaction, HaltOption, NodeLossReaction, QuickStopOption, StopOption};
pub use statusword::{DriveState, Statusword};
