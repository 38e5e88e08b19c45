//! One axis: configuration, state machine, targets, procedures.

#[expect(clippy::module_inception, reason = "a file has the name of its main type")]
pub(crate) mod axis;
pub(crate) mod axis_cycle;
mod axis_feed_forward;
pub(crate) mod axis_path;
mod axis_procedure;
mod axis_progress;
mod axis_recovery;
mod axis_setup;
pub(crate) mod axis_state;
mod axis_step;
mod axis_stop;
pub(crate) mod config;
mod drive_status;
pub(crate) mod error;
pub(crate) mod homing;
pub(crate) mod host_loss;
pub(crate) mod limits;
pub(crate) mod pdo_layout;
pub(crate) mod power;
mod procedure;
pub(crate) mod process_data;
pub(crate) mod ramp;
mod recovery;
mod script;
pub(crate) mod setup;
pub(crate) mod setup_steps;
pub(crate) mod status;
pub(crate) mod takeover;
mod target_path;
pub(crate) mod target_period;
pub(crate) mod target_source;
pub(crate) mod units;

pub use config::{AxisConfig, DriveConfig, NodeReset, PdoCobIds, VlConfig};
pub use error::{AxisFault, CommandError};
pub use homing::{HomingConfig, HomingState};
pub use host_loss::{HostLoss, HostLossReaction, HostWatch, StopOptions, StopRamp};
pub use limits::DriveLimits;
pub use pdo_layout::{
    AxisInputs, Feedback, InputObject, OutputObject, OutputValues, PdoLayout, RpdoBytes,
    TargetObject,
};
pub use power::StopCause;
pub use process_data::ProbeState;
pub use status::{AxisError, AxisErrorKind, AxisPhase, AxisProgress, AxisStatistics, AxisStatus};
pub use takeover::Takeover;
pub use units::{
    DriveUnits, MotionLimit, MotionLimits, Scale, ScaleFinding, ScaleSource, UnitError,
};
