//! One axis: configuration, state machine, targets, procedures.

#[expect(clippy::module_inception, reason = "a file has the name of its main type")]
pub(crate) mod axis;
pub(crate) mod axis_cycle;
mod axis_procedure;
mod axis_progress;
pub(crate) mod axis_state;
pub(crate) mod command_error;
pub(crate) mod config;
mod drive_status;
pub(crate) mod homing;
pub(crate) mod host_loss;
pub(crate) mod motion_limits;
pub(crate) mod path_share;
pub(crate) mod pdo_layout;
pub(crate) mod phase;
mod power;
mod procedure;
pub(crate) mod ramp;
mod script;
mod set_point;
pub(crate) mod setup_steps;
pub(crate) mod statistics;
pub(crate) mod target_period;
mod target_source;
mod target_tickets;
pub(crate) mod units;
mod verification;

pub use command_error::CommandError;
pub use config::{AxisConfig, AxisFault, DriveConfig, NodeReset};
pub use homing::{HomingConfig, HomingState};
pub use host_loss::{HostLoss, HostLossReaction, HostWatch, StopOptions, StopRamp};
pub use motion_limits::{MotionLimit, MotionLimits};
pub use pdo_layout::{Feedback, PdoLayout, RpdoBytes, TargetObject};
pub use phase::{AxisError, AxisPhase, AxisProgress};
pub use statistics::AxisStatistics;
pub use units::{Scale, UnitError};
