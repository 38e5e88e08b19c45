//! Status of an axis in one cycle.

use std::time::Duration;

use ecan_canopen::{
    DriveState, Heartbeat, Network, NmtState, NodeAddress, OperatingMode, Statusword,
};

use super::axis::Axis;
use super::input_object::AxisInputs;
use super::phase::{AxisError, AxisPhase};
use super::stop::StopCause;
use super::units::Scale;
use crate::guard::feed_forward::FeedForward;
use crate::guard::input::HoldReason;
use crate::guard::position_range::PositionRange;
use crate::guard::terms::{Decision, GuardState};

ecan_protocol::text_enum! {
    /// Kind of the failure of the last command to an axis: an [`AxisError`] without its details.
    #[non_exhaustive]
    pub enum AxisErrorKind: u8;
    /// The configuration failed.
    Setup = 1, "configuration failed";
    /// The drive restarted and lost its configuration.
    Restarted = 2, "the drive restarted";
    /// The drive did not reach Operation Enabled in time.
    EnableTimedOut = 3, "not enabled in time";
    /// The drive has a fault.
    Fault = 4, "the drive is in fault";
    /// The drive stays in fault after a reset.
    ResetFailed = 5, "the drive stays in fault after a reset";
    /// The axis held.
    Held = 6, "the axis held";
    /// Homing ended without a home position.
    Homing = 7, "homing failed";
    /// Homing did not end in time.
    HomingTimedOut = 8, "homing timed out";
    /// The mode could not be changed.
    Mode = 9, "the drive rejected a mode";
    /// The drive did not switch its power off in time.
    NotDisabled = 10, "the drive does not switch off";
    /// The drive does not answer and may be moving.
    NotStopped = 11, "the drive does not answer and may be moving";
}

impl From<AxisError> for AxisErrorKind {
    fn from(error: AxisError) -> Self {
        match error {
            AxisError::Setup(_) => Self::Setup,
            AxisError::Restarted => Self::Restarted,
            AxisError::EnableTimedOut { .. } => Self::EnableTimedOut,
            AxisError::Fault { .. } => Self::Fault,
            AxisError::ResetFailed { .. } => Self::ResetFailed,
            AxisError::Held(_) => Self::Held,
            AxisError::Homing(_) => Self::Homing,
            AxisError::HomingTimedOut { .. } => Self::HomingTimedOut,
            AxisError::Mode(_) => Self::Mode,
            AxisError::NotDisabled { .. } => Self::NotDisabled,
            AxisError::NotStopped { .. } => Self::NotStopped,
        }
    }
}

/// Status of an axis in one cycle, complete: by [`Cia402::axis_status`](crate::Cia402::axis_status), and
/// in a snapshot by [`AxesSnapshot`](crate::AxesSnapshot).
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct AxisStatus {
    /// Address of the drive.
    pub address: NodeAddress,
    /// Phase.
    pub phase: AxisPhase,
    /// Time since the phase began.
    pub elapsed: Duration,
    /// Failure of the last command.
    pub error: Option<AxisErrorKind>,
    /// Mode that the drive has confirmed; before that, the configured one.
    pub mode: OperatingMode,
    /// The last statusword, however old; `None` before the first.
    pub statusword: Option<Statusword>,
    /// Error code of the last emergency message; 0 for none, or after the node reset it.
    pub error_code: u16,
    /// Last NMT state that the node reported.
    pub nmt_state: Option<NmtState>,
    /// State of the node's heartbeat.
    pub heartbeat: Heartbeat,
    /// The last usable actual position, in steps; `None` before the first.
    pub actual: Option<i32>,
    /// Age of the actual position in cycles; 0 is this cycle, 65535 is more or never.
    pub actual_age: u16,
    /// The last target sent to an axis that follows targets.
    pub target: Option<i32>,
    /// Values of the further objects in the last TPDOs, see
    /// [`AxisConfig::inputs`](crate::AxisConfig::inputs).
    pub inputs: AxisInputs,
    /// The feed-forward that was sent last.
    pub feed_forward: FeedForward,
    /// Decision about the target of the cycle.
    pub decision: Decision,
    /// Reason of a hold.
    pub hold_reason: Option<HoldReason>,
    /// Cause of the stop that is pending or complete.
    pub stop_cause: Option<StopCause>,
    /// The drive is configured.
    pub is_configured: bool,
    /// The axis follows the application's targets; false while it is halted.
    pub is_running: bool,
    /// A halted axis is at rest; true for an axis that is not running.
    pub is_at_rest: bool,
    /// A drive with its own trajectory has reached its target.
    pub is_target_reached: bool,
    /// The axis has stopped.
    pub is_stopped: bool,
    /// A recovery continues.
    pub is_recovering: bool,
    pub(crate) scale: Scale,
    pub(crate) range: PositionRange,
}

impl AxisStatus {
    /// The state in the statusword.
    pub fn drive_state(&self) -> Option<DriveState> {
        self.statusword.and_then(Statusword::state)
    }

    /// The actual position in degrees by the axis's scale.
    pub fn actual_degrees(&self) -> Option<f64> {
        self.actual.map(|actual| self.scale.degrees(actual))
    }

    /// The actual position in radians by the axis's scale.
    pub fn actual_radians(&self) -> Option<f64> {
        self.actual.map(|actual| self.scale.radians(actual))
    }

    /// Target minus actual position of a running axis in steps: see
    /// [`Cia402::following_error`](crate::Cia402::following_error).
    pub fn following_error(&self) -> Option<i64> {
        Some(self.range.distance(self.actual?, self.target?))
    }
}

impl Axis {
    /// Returns whether a drive with its own trajectory has reached its target.
    pub(crate) fn is_target_reached(&self) -> bool {
        let is_rejected = matches!(self.decision, Decision::Reject(_));
        if self.targets.requested.is_some_and(|new| self.target() != Some(new)) && !is_rejected {
            return false;
        }
        let has_taken = match self.mode {
            OperatingMode::ProfilePosition => {
                self.target().is_some_and(|target| self.set_point.has_taken(target))
            }
            mode => !mode.is_cyclic() && self.target().is_some(),
        };
        has_taken && self.drive.has(Statusword::TARGET_REACHED)
    }

    pub(crate) fn hold_reason(&self) -> Option<HoldReason> {
        match self.guard.state() {
            GuardState::Holding { reason } => Some(reason),
            _ => None,
        }
    }

    pub(crate) fn status(&self, network: &Network, now_ns: u64) -> AxisStatus {
        AxisStatus {
            address: self.config.address,
            phase: self.phase,
            elapsed: Duration::from_nanos(now_ns.saturating_sub(self.phase_since_ns)),
            error: self.error.map(AxisErrorKind::from),
            mode: self.mode,
            statusword: self.drive.statusword,
            error_code: self.error_code(network),
            nmt_state: network.nmt_state(self.node),
            heartbeat: network.heartbeat(self.node),
            actual: self.guard.actual(),
            actual_age: self.guard.actual_age(),
            target: self.target(),
            inputs: self.further.inputs,
            feed_forward: self.further.feed_forward.last(),
            decision: self.decision,
            hold_reason: self.hold_reason(),
            stop_cause: self.state.stop().map(|stop| stop.cause),
            is_configured: self.setup.is_complete(),
            is_running: self.follows_application(),
            is_at_rest: self.is_at_rest(),
            is_target_reached: self.is_target_reached(),
            is_stopped: self.is_stopped(now_ns),
            is_recovering: self.recovery.is_some(),
            scale: Scale::of_parts(self.config.scale.parts()),
            range: self.config.range,
        }
    }
}
