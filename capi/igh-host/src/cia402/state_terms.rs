//! What the state of an axis is made of

use ecan_canopen::Heartbeat;
use ecan_cia402::{AxisError, AxisPhase, Decision, HoldReason, TargetRejection, WaitReason};

/// What an axis is doing.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_phase_t {
    /// Not configured yet, or not any more: the drive restarted.
    IGH_CIA402_PHASE_NOT_CONFIGURED = 0,
    /// The steps of its configuration are being done.
    IGH_CIA402_PHASE_CONFIGURING = 1,
    /// Its mode is written and waited for.
    IGH_CIA402_PHASE_SETTING_MODE = 2,
    /// Its configuration failed.
    IGH_CIA402_PHASE_SETUP_FAILED = 3,
    /// Configured; nothing is commanded.
    IGH_CIA402_PHASE_STANDBY = 4,
    /// Its actual position is being established.
    IGH_CIA402_PHASE_READING = 5,
    /// Its actual position is known; the drive is not enabled.
    IGH_CIA402_PHASE_READY = 6,
    /// The drive is brought to Operation Enabled.
    IGH_CIA402_PHASE_ENABLING = 7,
    /// Follows targets.
    IGH_CIA402_PHASE_RUNNING = 8,
    /// Is being brought to rest, or was, by igh_cia402_halt().
    IGH_CIA402_PHASE_HALTED = 9,
    /// Gets no targets until it is taken up again; hold_reason says why.
    IGH_CIA402_PHASE_HOLDING = 10,
    /// A quick stop was commanded.
    IGH_CIA402_PHASE_QUICK_STOP = 11,
    /// The drive's power is being switched off.
    IGH_CIA402_PHASE_DISABLING = 12,
    /// A fault is being reset.
    IGH_CIA402_PHASE_RESETTING_FAULT = 13,
    /// The drive has a fault.
    IGH_CIA402_PHASE_FAULT = 14,
    /// The mode is being changed.
    IGH_CIA402_PHASE_CHANGING_MODE = 15,
    /// Homing is prepared or wound up.
    IGH_CIA402_PHASE_PREPARING_HOMING = 16,
    /// Homing.
    IGH_CIA402_PHASE_HOMING = 17,
    /// Another one.
    IGH_CIA402_PHASE_OTHER = 255,
}

/// What became of an axis' target.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_decision_t {
    /// The axis is not taken up, or holds: no target.
    IGH_CIA402_DECISION_CLOSED = 0,
    /// The drive is not enabled: it got its own actual position.
    IGH_CIA402_DECISION_TRACK = 1,
    /// The first target of an enabled drive: its actual position.
    IGH_CIA402_DECISION_FIRST = 2,
    /// The application's target went out, or the last one again where it gave none.
    IGH_CIA402_DECISION_TARGET = 3,
    /// Nothing now; decision_reason is an igh_cia402_wait_t.
    IGH_CIA402_DECISION_WAIT = 4,
    /// Not this target; decision_reason is an igh_cia402_refusal_t.
    IGH_CIA402_DECISION_REFUSED = 5,
}

/// Why an axis that is taken up got nothing in a cycle. Its motion must not go on meanwhile.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_wait_t {
    /// The working counter of this cycle is incomplete.
    IGH_CIA402_WAIT_WORKING_COUNTER = 1,
    /// The last image may not have arrived and is repeated.
    IGH_CIA402_WAIT_IMAGE_HELD = 2,
    /// The first target must be an actual position of this very cycle, and there is none.
    IGH_CIA402_WAIT_NO_FRESH_POSITION = 3,
    /// The drive still holds an old target, far from the axis: it must be switched off first.
    IGH_CIA402_WAIT_HOLDS_OLD_TARGET = 4,
    /// The image of the last cycle had no room for a frame of the channel.
    IGH_CIA402_WAIT_IMAGE_FULL = 5,
    /// This cycle has had its target.
    IGH_CIA402_WAIT_SPENT = 6,
    /// A frame was refused in this cycle; the axis will hold.
    IGH_CIA402_WAIT_FRAME_REFUSED = 7,
}

/// Why a target was not taken. The target before it stands.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_refusal_t {
    /// Too far from the target before.
    IGH_CIA402_REFUSAL_STEP = 1,
    /// Too far from the actual position.
    IGH_CIA402_REFUSAL_WINDOW = 2,
    /// Outside the bounds of the axis.
    IGH_CIA402_REFUSAL_BOUNDS = 3,
    /// The position counter cannot stand there.
    IGH_CIA402_REFUSAL_COUNTER = 4,
    /// The mode takes no targets.
    IGH_CIA402_REFUSAL_NO_TARGETS = 5,
    /// Another reason.
    IGH_CIA402_REFUSAL_OTHER = 255,
}

/// Why an axis holds: it gets no targets until igh_cia402_enable().
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_hold_t {
    /// It does not hold.
    IGH_CIA402_HOLD_NONE = 0,
    /// The gateway went out of service.
    IGH_CIA402_HOLD_GATEWAY_LOST = 1,
    /// Frames under way to the gateway were given up, a target may be among them.
    IGH_CIA402_HOLD_FRAMES_DISCARDED = 2,
    /// The working counter stayed incomplete for longer than wc_misses.
    IGH_CIA402_HOLD_WORKING_COUNTER = 3,
    /// The channel went bus-off.
    IGH_CIA402_HOLD_BUS_OFF = 4,
    /// The channel left the bus without being bus-off.
    IGH_CIA402_HOLD_CHANNEL_STOPPED = 5,
    /// The gateway's transmit queue was full.
    IGH_CIA402_HOLD_QUEUE_FULL = 6,
    /// The gateway reported a target as not sent.
    IGH_CIA402_HOLD_TARGET_LOST = 7,
    /// The drive's heartbeat stayed away.
    IGH_CIA402_HOLD_HEARTBEAT_LOST = 8,
    /// The drive is not Operational, or restarted.
    IGH_CIA402_HOLD_NOT_OPERATIONAL = 9,
    /// The drive was out of sight, and its configuration is being verified.
    IGH_CIA402_HOLD_UNVERIFIED = 10,
    /// No usable TPDO came for longer than tpdo_timeout.
    IGH_CIA402_HOLD_TPDO_LOST = 11,
    /// The drive left Operation Enabled.
    IGH_CIA402_HOLD_LEFT_OPERATION_ENABLED = 12,
    /// The drive stopped following its target.
    IGH_CIA402_HOLD_NOT_FOLLOWING = 13,
    /// The drive reports a following error.
    IGH_CIA402_HOLD_FOLLOWING_ERROR = 14,
    /// The axis moved while it was to be taken up.
    IGH_CIA402_HOLD_MOVING = 15,
    /// The application commanded it.
    IGH_CIA402_HOLD_COMMANDED = 16,
    /// Another reason.
    IGH_CIA402_HOLD_OTHER = 255,
}

/// What went wrong with the last command to an axis; igh_cia402_get_axis_text() tells more.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_axis_error_t {
    /// Nothing.
    IGH_CIA402_AXIS_ERROR_NONE = 0,
    /// The configuration failed.
    IGH_CIA402_AXIS_ERROR_SETUP = 1,
    /// The drive restarted and has forgotten its configuration.
    IGH_CIA402_AXIS_ERROR_RESTARTED = 2,
    /// The drive did not reach Operation Enabled in time.
    IGH_CIA402_AXIS_ERROR_ENABLE_TIMED_OUT = 3,
    /// The drive has a fault; error_code.
    IGH_CIA402_AXIS_ERROR_FAULT = 4,
    /// The drive stays in fault after a reset; error_code.
    IGH_CIA402_AXIS_ERROR_RESET_REFUSED = 5,
    /// The axis held; hold_reason.
    IGH_CIA402_AXIS_ERROR_HELD = 6,
    /// Homing ended without a home position.
    IGH_CIA402_AXIS_ERROR_HOMING = 7,
    /// Homing took too long.
    IGH_CIA402_AXIS_ERROR_HOMING_TIMED_OUT = 8,
    /// A mode was not taken.
    IGH_CIA402_AXIS_ERROR_MODE = 9,
    /// The drive did not switch its power off in time.
    IGH_CIA402_AXIS_ERROR_NOT_DISABLED = 10,
    /// Another one.
    IGH_CIA402_AXIS_ERROR_OTHER = 255,
}

/// How a node's heartbeat stands.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_canopen_heartbeat_t {
    /// It is not watched.
    IGH_CANOPEN_HEARTBEAT_UNWATCHED = 0,
    /// It has not been heard since watching began or the node booted.
    IGH_CANOPEN_HEARTBEAT_UNKNOWN = 1,
    /// It comes in time.
    IGH_CANOPEN_HEARTBEAT_ACTIVE = 2,
    /// It stayed away.
    IGH_CANOPEN_HEARTBEAT_TIMED_OUT = 3,
}

pub(crate) fn phase(phase: AxisPhase) -> igh_cia402_phase_t {
    use igh_cia402_phase_t::*;
    match phase {
        AxisPhase::NotConfigured => IGH_CIA402_PHASE_NOT_CONFIGURED,
        AxisPhase::Configuring => IGH_CIA402_PHASE_CONFIGURING,
        AxisPhase::SettingMode(_) => IGH_CIA402_PHASE_SETTING_MODE,
        AxisPhase::SetupFailed => IGH_CIA402_PHASE_SETUP_FAILED,
        AxisPhase::Standby => IGH_CIA402_PHASE_STANDBY,
        AxisPhase::Reading(..) => IGH_CIA402_PHASE_READING,
        AxisPhase::Ready => IGH_CIA402_PHASE_READY,
        AxisPhase::Enabling(_) => IGH_CIA402_PHASE_ENABLING,
        AxisPhase::Running => IGH_CIA402_PHASE_RUNNING,
        AxisPhase::Halted => IGH_CIA402_PHASE_HALTED,
        AxisPhase::Holding(_) => IGH_CIA402_PHASE_HOLDING,
        AxisPhase::QuickStop => IGH_CIA402_PHASE_QUICK_STOP,
        AxisPhase::Disabling => IGH_CIA402_PHASE_DISABLING,
        AxisPhase::ResettingFault => IGH_CIA402_PHASE_RESETTING_FAULT,
        AxisPhase::Fault => IGH_CIA402_PHASE_FAULT,
        AxisPhase::ChangingMode(_) => IGH_CIA402_PHASE_CHANGING_MODE,
        AxisPhase::PreparingHoming => IGH_CIA402_PHASE_PREPARING_HOMING,
        AxisPhase::Homing(_) => IGH_CIA402_PHASE_HOMING,
        _ => IGH_CIA402_PHASE_OTHER,
    }
}

pub(crate) fn hold(reason: HoldReason) -> igh_cia402_hold_t {
    use igh_cia402_hold_t::*;
    match reason {
        HoldReason::GatewayLost => IGH_CIA402_HOLD_GATEWAY_LOST,
        HoldReason::FramesDiscarded => IGH_CIA402_HOLD_FRAMES_DISCARDED,
        HoldReason::WorkingCounter => IGH_CIA402_HOLD_WORKING_COUNTER,
        HoldReason::BusOff => IGH_CIA402_HOLD_BUS_OFF,
        HoldReason::ChannelStopped => IGH_CIA402_HOLD_CHANNEL_STOPPED,
        HoldReason::QueueFull => IGH_CIA402_HOLD_QUEUE_FULL,
        HoldReason::TargetLost => IGH_CIA402_HOLD_TARGET_LOST,
        HoldReason::HeartbeatLost => IGH_CIA402_HOLD_HEARTBEAT_LOST,
        HoldReason::NotOperational => IGH_CIA402_HOLD_NOT_OPERATIONAL,
        HoldReason::Unverified => IGH_CIA402_HOLD_UNVERIFIED,
        HoldReason::TpdoLost(_) => IGH_CIA402_HOLD_TPDO_LOST,
        HoldReason::LeftOperationEnabled(_) => IGH_CIA402_HOLD_LEFT_OPERATION_ENABLED,
        HoldReason::NotFollowing => IGH_CIA402_HOLD_NOT_FOLLOWING,
        HoldReason::FollowingError => IGH_CIA402_HOLD_FOLLOWING_ERROR,
        HoldReason::Moving => IGH_CIA402_HOLD_MOVING,
        HoldReason::Commanded => IGH_CIA402_HOLD_COMMANDED,
        _ => IGH_CIA402_HOLD_OTHER,
    }
}

pub(crate) fn trouble(trouble: Option<AxisError>) -> igh_cia402_axis_error_t {
    use igh_cia402_axis_error_t::*;
    match trouble {
        None => IGH_CIA402_AXIS_ERROR_NONE,
        Some(AxisError::Setup(_)) => IGH_CIA402_AXIS_ERROR_SETUP,
        Some(AxisError::Restarted) => IGH_CIA402_AXIS_ERROR_RESTARTED,
        Some(AxisError::EnableTimedOut { .. }) => IGH_CIA402_AXIS_ERROR_ENABLE_TIMED_OUT,
        Some(AxisError::Fault { .. }) => IGH_CIA402_AXIS_ERROR_FAULT,
        Some(AxisError::ResetRefused { .. }) => IGH_CIA402_AXIS_ERROR_RESET_REFUSED,
        Some(AxisError::Held(_)) => IGH_CIA402_AXIS_ERROR_HELD,
        Some(AxisError::Homing(_)) => IGH_CIA402_AXIS_ERROR_HOMING,
        Some(AxisError::HomingTimedOut { .. }) => IGH_CIA402_AXIS_ERROR_HOMING_TIMED_OUT,
        Some(AxisError::Mode(_)) => IGH_CIA402_AXIS_ERROR_MODE,
        Some(AxisError::NotDisabled { .. }) => IGH_CIA402_AXIS_ERROR_NOT_DISABLED,
        Some(_) => IGH_CIA402_AXIS_ERROR_OTHER,
    }
}

/// A decision and its reason.
pub(crate) fn decision(decision: Decision) -> (igh_cia402_decision_t, u8) {
    use igh_cia402_decision_t::*;
    use igh_cia402_refusal_t::*;
    use igh_cia402_wait_t::*;
    match decision {
        Decision::Closed => (IGH_CIA402_DECISION_CLOSED, 0),
        Decision::Track(_) => (IGH_CIA402_DECISION_TRACK, 0),
        Decision::First(_) => (IGH_CIA402_DECISION_FIRST, 0),
        Decision::Target(_) => (IGH_CIA402_DECISION_TARGET, 0),
        Decision::Wait(reason) => {
            let reason = match reason {
                WaitReason::WorkingCounter => IGH_CIA402_WAIT_WORKING_COUNTER,
                WaitReason::ImageHeld => IGH_CIA402_WAIT_IMAGE_HELD,
                WaitReason::NoFreshPosition => IGH_CIA402_WAIT_NO_FRESH_POSITION,
                WaitReason::HoldsOldTarget => IGH_CIA402_WAIT_HOLDS_OLD_TARGET,
                WaitReason::ImageFull => IGH_CIA402_WAIT_IMAGE_FULL,
                WaitReason::Spent => IGH_CIA402_WAIT_SPENT,
                WaitReason::Refused => IGH_CIA402_WAIT_FRAME_REFUSED,
            };
            (IGH_CIA402_DECISION_WAIT, reason as u8)
        }
        Decision::Refuse(refusal) => {
            let reason = match refusal {
                TargetRejection::Step { .. } => IGH_CIA402_REFUSAL_STEP,
                TargetRejection::Window { .. } => IGH_CIA402_REFUSAL_WINDOW,
                TargetRejection::Bounds { .. } => IGH_CIA402_REFUSAL_BOUNDS,
                TargetRejection::Counter { .. } => IGH_CIA402_REFUSAL_COUNTER,
                TargetRejection::NoTargets => IGH_CIA402_REFUSAL_NO_TARGETS,
                _ => IGH_CIA402_REFUSAL_OTHER,
            };
            (IGH_CIA402_DECISION_REFUSED, reason as u8)
        }
    }
}

pub(crate) fn heartbeat(heartbeat: Heartbeat) -> igh_canopen_heartbeat_t {
    use igh_canopen_heartbeat_t::*;
    match heartbeat {
        Heartbeat::Unconfigured => IGH_CANOPEN_HEARTBEAT_UNWATCHED,
        Heartbeat::Unknown => IGH_CANOPEN_HEARTBEAT_UNKNOWN,
        Heartbeat::Active => IGH_CANOPEN_HEARTBEAT_ACTIVE,
        Heartbeat::TimedOut => IGH_CANOPEN_HEARTBEAT_TIMED_OUT,
    }
}
