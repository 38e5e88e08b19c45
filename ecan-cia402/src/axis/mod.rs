//! Layer 2: CiA 402 axes over the CANopen network. It knows drives, targets and what must never
//! happen to them.

// Rules: pure, without frames or time
mod drain;
mod guard;
mod guard_input;
mod guard_terms;
mod position_range;
mod units;

pub use guard::MotionGuard;
pub use guard_input::{
    Actual, ChannelView, DriveView, GuardInput, HoldReason, PathStatus, PositionUnavailable,
};
pub use guard_terms::{Decision, GuardLimits, GuardState, TargetKind, TargetRejection, WaitReason};
pub use position_range::PositionRange;
pub use units::{Scale, UnitError};

#[cfg(test)]
mod guard_path_model;
#[cfg(test)]
mod guard_properties;
#[cfg(test)]
mod guard_tests;

// What a drive is told, step by step
mod homing;
mod pdo_layout;
mod power;
mod procedure;
mod ramp;
mod script;
mod set_point;
mod start_up;

pub use homing::{HomingConfig, HomingState};
pub use pdo_layout::{Feedback, PdoLayout, RpdoBytes, TargetObject};

// One axis
mod axis;
mod axis_cycle;
mod axis_procedure;
mod axis_state;
mod channel_watch;
mod drive_status;
mod phase;
mod settings;
mod statistics;
mod target_source;
mod target_tickets;
mod verification;

pub use phase::{AxisError, AxisPhase, AxisProgress};
pub use settings::{AxisConfig, AxisFault, DriveConfig, NodeReset};
pub use statistics::AxisStatistics;

// All axes of a bus
mod context;
mod context_blocking;
mod context_commands;
mod context_cycle;
mod context_sdo;
mod error;
mod load;
mod lookup;
mod shutdown;

pub use context::{Cia402, Cia402Config};
pub use context_cycle::SendSummary;
pub use error::{AxisFaults, AxisTimeout, Cia402Error, CommandError, ScheduleError};
pub use load::{BusLoad, LoadWarning, axis_traffic};
pub use shutdown::Shutdown;
