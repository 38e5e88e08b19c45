//! Values of CiA 402 objects.

mod controlword;
mod mode;
mod option_code;
mod si_unit;
mod statusword;
mod touch_probe;

pub use controlword::{Command, Controlword};
pub use mode::{OperatingMode, SupportedModes};
pub use option_code::{FaultReaction, HaltOption, NodeLossReaction, QuickStopOption, StopOption};
pub use si_unit::{AngleUnit, SiUnit};
pub use statusword::{DriveState, Statusword};
pub use touch_probe::{Probe, ProbeSource, ProbeStatus, ProbeTrigger};
