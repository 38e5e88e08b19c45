//! One axis: configuration, state machine, targets, procedures.

#[expect(clippy::module_inception, reason = "a file has the name of its main type")]
pub(crate) mod axis;
pub(crate) mod axis_cycle;
mod axis_step;
pub(crate) mod config;
pub(crate) mod drive_link;
mod drive_status;
pub(crate) mod error;
pub(crate) mod host_loss;
pub(crate) mod limits;
pub(crate) mod pdo_layout;
pub(crate) mod plan;
pub(crate) mod power;
pub(crate) mod procedure;
pub(crate) mod process_data;
pub(crate) mod ramp;
pub(crate) mod script;
pub(crate) mod setup;
pub(crate) mod setup_steps;
pub(crate) mod status;
mod takeover;
pub(crate) mod target_path;
pub(crate) mod targets;
pub(crate) mod task;
pub(crate) mod units;

pub use axis::{AxisCommand, StopKind};
pub use config::{
    AxisConfig, DriveConfig, NodeReset, PathTolerances, PdoCobIds, PdoConfig, Takeover, VlConfig,
};
pub use error::{AxisFault, CommandError};
pub use host_loss::{HostLoss, HostLossReaction, HostWatch, StopOptions, StopRamp};
pub use limits::DriveLimits;
pub use pdo_layout::{
    AxisInputs, Feedback, InputObject, OutputObject, OutputValues, PdoLayout, RpdoBytes,
    TargetObject,
};
pub use power::StopCause;
pub use procedure::HomingConfig;
pub use process_data::{Output, ProbeState};
pub use setup::DriveValues;
pub use status::{AxisError, AxisErrorKind, AxisPhase, AxisProgress, AxisStatistics, HomingState};
pub use units::{
    DriveUnits, MotionLimit, MotionLimits, Scale, ScaleFinding, ScaleSource, UnitError,
};
