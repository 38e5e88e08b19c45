//! Values of an axis' state

use ecan_c_boundary::mirror;
use ecan_canopen::Heartbeat;
use ecan_cia402::{
    AxisErrorKind, AxisPhase, Decision, HoldReason, StopCause, TargetRejection, WaitReason,
};

mirror! {
    /// Phase of an axis.
    pub enum igh_cia402_phase_t from AxisPhase {
        /// Not configured yet, or not any more after a restart of the drive.
        IGH_CIA402_PHASE_NOT_CONFIGURED = 0 => AxisPhase::NotConfigured,
        /// Its configuration is in progress.
        IGH_CIA402_PHASE_CONFIGURING = 1 => AxisPhase::Configuring,
        /// Its mode is written; the confirmation is pending.
        IGH_CIA402_PHASE_SETTING_MODE = 2 => AxisPhase::SettingMode(_),
        /// Its configuration failed.
        IGH_CIA402_PHASE_SETUP_FAILED = 3 => AxisPhase::SetupFailed,
        /// Configured, without a command.
        IGH_CIA402_PHASE_STANDBY = 4 => AxisPhase::Standby,
        /// Its actual position is being determined.
        IGH_CIA402_PHASE_READING = 5 => AxisPhase::Reading(..),
        /// Its actual position is known; the drive is not enabled.
        IGH_CIA402_PHASE_READY = 6 => AxisPhase::Ready,
        /// The drive is being enabled.
        IGH_CIA402_PHASE_ENABLING = 7 => AxisPhase::Enabling(_),
        /// Active: follows targets.
        IGH_CIA402_PHASE_RUNNING = 8 => AxisPhase::Running,
        /// At rest, or being brought to rest, by igh_cia402_halt().
        IGH_CIA402_PHASE_HALTED = 9 => AxisPhase::Halted,
        /// Holds: gets no targets until it is activated again; see hold_reason.
        IGH_CIA402_PHASE_HOLDING = 10 => AxisPhase::Holding(_),
        /// The drive is being stopped; see stop_cause.
        IGH_CIA402_PHASE_STOPPING = 11 => AxisPhase::Stopping(_),
        /// The drive has stopped: it is off, or at rest after a quick stop; see stop_cause.
        IGH_CIA402_PHASE_STOPPED = 12 => AxisPhase::Stopped(_),
        /// A fault is being reset.
        IGH_CIA402_PHASE_RESETTING_FAULT = 13 => AxisPhase::ResettingFault,
        /// The drive has a fault.
        IGH_CIA402_PHASE_FAULT = 14 => AxisPhase::Fault,
        /// The mode is being changed.
        IGH_CIA402_PHASE_CHANGING_MODE = 15 => AxisPhase::ChangingMode(_),
        /// Homing is being prepared or completed.
        IGH_CIA402_PHASE_PREPARING_HOMING = 16 => AxisPhase::PreparingHoming,
        /// Homing.
        IGH_CIA402_PHASE_HOMING = 17 => AxisPhase::Homing(_),
        /// The drive is to be stopped, may be moving, and reports nothing; the stop is repeated.
        IGH_CIA402_PHASE_UNCONTROLLED = 18 => AxisPhase::Uncontrolled(_),
        /// First contact: the state of the drive is read before anything else is sent.
        IGH_CIA402_PHASE_INSPECTING = 19 => AxisPhase::Inspecting,
        /// Another one.
        IGH_CIA402_PHASE_OTHER = 255 => _,
    }
}

mirror! {
    /// Decision on an axis' target.
    pub enum igh_cia402_decision_t from Decision {
        /// The axis is not active, or holds: no target.
        IGH_CIA402_DECISION_CLOSED = 0 => Decision::Closed,
        /// The drive is not enabled: it got its own actual position.
        IGH_CIA402_DECISION_TRACK = 1 => Decision::Track(_),
        /// The first target of an enabled drive: its actual position.
        IGH_CIA402_DECISION_FIRST = 2 => Decision::First(_),
        /// The application's target was sent, or the last one again if there is no new one.
        IGH_CIA402_DECISION_TARGET = 3 => Decision::Target(_),
        /// No target in this cycle; decision_reason is an igh_cia402_wait_t.
        IGH_CIA402_DECISION_WAIT = 4 => Decision::Wait(_),
        /// The target was rejected; decision_reason is an igh_cia402_rejection_t.
        IGH_CIA402_DECISION_REJECTED = 5 => Decision::Reject(_),
    }
}

mirror! {
    /// Reason why an active axis got nothing in a cycle. Its motion must not continue.
    pub enum igh_cia402_wait_t from WaitReason {
        /// The working counter of this cycle is incomplete.
        IGH_CIA402_WAIT_WORKING_COUNTER = 1 => WaitReason::WorkingCounter,
        /// The last image is unconfirmed and is repeated.
        IGH_CIA402_WAIT_IMAGE_UNCONFIRMED = 2 => WaitReason::ImageUnconfirmed,
        /// The first target must be an actual position of this cycle, and there is none.
        IGH_CIA402_WAIT_NO_FRESH_POSITION = 3 => WaitReason::NoFreshPosition,
        /// The drive has an old target, far from the axis: it must be disabled first.
        IGH_CIA402_WAIT_HOLDS_OLD_TARGET = 4 => WaitReason::HoldsOldTarget,
        /// The image of the last cycle had no room for a frame of the channel.
        IGH_CIA402_WAIT_IMAGE_FULL = 5 => WaitReason::ImageFull,
        /// The target of this cycle was sent already.
        IGH_CIA402_WAIT_SPENT = 6 => WaitReason::Spent,
        /// A frame was rejected in this cycle; the axis will hold.
        IGH_CIA402_WAIT_FRAME_REJECTED = 7 => WaitReason::Rejected,
        /// No target is due: the target period has not ended, or the cycle has no SYNC. Not a
        /// disturbance: the motion continues.
        IGH_CIA402_WAIT_NOT_DUE = 8 => WaitReason::NotDue,
        /// Frames that were sent before still wait in the gateway: the bus is occupied.
        IGH_CIA402_WAIT_BACKLOG = 11 => WaitReason::Backlog,
        /// igh_cia402_process_rx() was not called in this cycle.
        IGH_CIA402_WAIT_NOT_RECEIVED = 9 => WaitReason::NotReceived,
        /// Another axis of igh_cia402_stop_together() cannot get a target in this cycle.
        IGH_CIA402_WAIT_TOGETHER = 10 => WaitReason::Together,
    }
}

mirror! {
    /// Reason why a target was rejected. The previous target stays.
    pub enum igh_cia402_rejection_t from TargetRejection {
        /// Too far from the target before.
        IGH_CIA402_REJECTION_STEP = 1 => TargetRejection::Step { .. },
        /// Too far from the actual position.
        IGH_CIA402_REJECTION_WINDOW = 2 => TargetRejection::Window { .. },
        /// Outside the bounds of the axis.
        IGH_CIA402_REJECTION_BOUNDS = 3 => TargetRejection::Bounds { .. },
        /// The position counter does not have this position.
        IGH_CIA402_REJECTION_COUNTER = 4 => TargetRejection::Counter { .. },
        /// The mode has no targets.
        IGH_CIA402_REJECTION_NO_TARGETS = 5 => TargetRejection::NoTargets,
        /// Another reason.
        IGH_CIA402_REJECTION_OTHER = 255 => _,
    }
}

mirror! {
    /// Reason of a hold: the axis gets no targets until igh_cia402_enable().
    pub enum igh_cia402_hold_t from Option<HoldReason> {
        /// It does not hold.
        IGH_CIA402_HOLD_NONE = 0 => None,
        /// The gateway is not ready any more.
        IGH_CIA402_HOLD_GATEWAY_LOST = 1 => Some(HoldReason::GatewayLost),
        /// Pending frames were discarded, possibly with a target.
        IGH_CIA402_HOLD_FRAMES_DISCARDED = 2 => Some(HoldReason::FramesDiscarded),
        /// The working counter stayed incomplete for longer than wc_misses.
        IGH_CIA402_HOLD_WORKING_COUNTER = 3 => Some(HoldReason::WorkingCounter),
        /// The channel went bus-off.
        IGH_CIA402_HOLD_BUS_OFF = 4 => Some(HoldReason::BusOff),
        /// The channel stopped without being bus-off.
        IGH_CIA402_HOLD_CHANNEL_STOPPED = 5 => Some(HoldReason::ChannelStopped),
        /// The gateway's transmit queue was full.
        IGH_CIA402_HOLD_QUEUE_FULL = 6 => Some(HoldReason::QueueFull),
        /// The gateway reported a target as not sent.
        IGH_CIA402_HOLD_TARGET_LOST = 7 => Some(HoldReason::TargetLost),
        /// The drive's heartbeat was lost.
        IGH_CIA402_HOLD_HEARTBEAT_LOST = 8 => Some(HoldReason::HeartbeatLost),
        /// The drive is not Operational, or restarted.
        IGH_CIA402_HOLD_NOT_OPERATIONAL = 9 => Some(HoldReason::NotOperational),
        /// The drive was unreachable, and its configuration is being verified.
        IGH_CIA402_HOLD_UNVERIFIED = 10 => Some(HoldReason::Unverified),
        /// No usable TPDO for longer than tpdo_timeout.
        IGH_CIA402_HOLD_TPDO_LOST = 11 => Some(HoldReason::TpdoLost(_)),
        /// The drive left Operation Enabled.
        IGH_CIA402_HOLD_LEFT_OPERATION_ENABLED = 12 => Some(HoldReason::LeftOperationEnabled(_)),
        /// The drive stopped following its target.
        IGH_CIA402_HOLD_NOT_FOLLOWING = 13 => Some(HoldReason::NotFollowing),
        /// The drive reports a following error.
        IGH_CIA402_HOLD_FOLLOWING_ERROR = 14 => Some(HoldReason::FollowingError),
        /// The application commanded it.
        IGH_CIA402_HOLD_COMMANDED = 16 => Some(HoldReason::Commanded),
        /// TPDOs were missing, and the drive is not at its last target.
        IGH_CIA402_HOLD_NOT_AT_TARGET = 17 => Some(HoldReason::NotAtTarget),
        /// Another reason.
        IGH_CIA402_HOLD_OTHER = 255 => Some(_),
    }
}

mirror! {
    /// Cause of a stop.
    pub enum igh_cia402_stop_cause_t from Option<StopCause> {
        /// No stop is pending or complete.
        IGH_CIA402_STOP_CAUSE_NONE = 0 => None,
        /// igh_cia402_quick_stop().
        IGH_CIA402_STOP_CAUSE_QUICK_STOP = 1 => Some(StopCause::QuickStop),
        /// igh_cia402_disable().
        IGH_CIA402_STOP_CAUSE_DISABLE = 2 => Some(StopCause::Disable),
        /// igh_cia402_stop_all().
        IGH_CIA402_STOP_CAUSE_ALL = 3 => Some(StopCause::StopAll),
        /// igh_cia402_begin_shutdown().
        IGH_CIA402_STOP_CAUSE_SHUTDOWN = 4 => Some(StopCause::Shutdown),
        /// The axis held in a mode in which its drive would continue to move; see hold_reason.
        IGH_CIA402_STOP_CAUSE_HELD = 5 => Some(StopCause::Held(_)),
        /// A change of mode, or homing.
        IGH_CIA402_STOP_CAUSE_PROCEDURE = 6 => Some(StopCause::Procedure),
        /// The drive was not enabled in time.
        IGH_CIA402_STOP_CAUSE_ENABLE_TIMED_OUT = 7 => Some(StopCause::EnableTimedOut),
        /// igh_cia402_configure() of an enabled drive.
        IGH_CIA402_STOP_CAUSE_CONFIGURE = 8 => Some(StopCause::Configure),
        /// The drive was enabled at the first contact, or has another configuration.
        IGH_CIA402_STOP_CAUSE_TAKEOVER = 9 => Some(StopCause::Takeover),
        /// Another cause.
        IGH_CIA402_STOP_CAUSE_OTHER = 255 => Some(_),
    }
}

mirror! {
    /// Error of the last command to an axis; igh_cia402_get_axis_text() gives details.
    pub enum igh_cia402_axis_error_t from Option<AxisErrorKind> {
        /// No error.
        IGH_CIA402_AXIS_ERROR_NONE = 0 => None,
        /// The configuration failed.
        IGH_CIA402_AXIS_ERROR_SETUP = 1 => Some(AxisErrorKind::Setup),
        /// The drive restarted and lost its configuration.
        IGH_CIA402_AXIS_ERROR_RESTARTED = 2 => Some(AxisErrorKind::Restarted),
        /// The drive did not reach Operation Enabled in time.
        IGH_CIA402_AXIS_ERROR_ENABLE_TIMED_OUT = 3 => Some(AxisErrorKind::EnableTimedOut),
        /// The drive has a fault; error_code.
        IGH_CIA402_AXIS_ERROR_FAULT = 4 => Some(AxisErrorKind::Fault),
        /// The drive stays in fault after a reset; error_code.
        IGH_CIA402_AXIS_ERROR_RESET_FAILED = 5 => Some(AxisErrorKind::ResetFailed),
        /// The axis held; hold_reason.
        IGH_CIA402_AXIS_ERROR_HELD = 6 => Some(AxisErrorKind::Held),
        /// Homing ended without a home position.
        IGH_CIA402_AXIS_ERROR_HOMING = 7 => Some(AxisErrorKind::Homing),
        /// Homing timed out.
        IGH_CIA402_AXIS_ERROR_HOMING_TIMED_OUT = 8 => Some(AxisErrorKind::HomingTimedOut),
        /// The drive rejected a mode.
        IGH_CIA402_AXIS_ERROR_MODE = 9 => Some(AxisErrorKind::Mode),
        /// The drive was not disabled in time.
        IGH_CIA402_AXIS_ERROR_NOT_DISABLED = 10 => Some(AxisErrorKind::NotDisabled),
        /// The drive was enabled when it reported last, and does not answer.
        IGH_CIA402_AXIS_ERROR_NOT_STOPPED = 11 => Some(AxisErrorKind::NotStopped),
        /// Another one.
        IGH_CIA402_AXIS_ERROR_OTHER = 255 => Some(_),
    }
}

mirror! {
    /// State of a node's heartbeat.
    pub enum igh_canopen_heartbeat_t from Heartbeat {
        /// Not monitored.
        IGH_CANOPEN_HEARTBEAT_UNCONFIGURED = 0 => Heartbeat::Unconfigured,
        /// None since monitoring started or the node booted.
        IGH_CANOPEN_HEARTBEAT_UNKNOWN = 1 => Heartbeat::Unknown,
        /// Received in time.
        IGH_CANOPEN_HEARTBEAT_ACTIVE = 2 => Heartbeat::Active,
        /// Lost.
        IGH_CANOPEN_HEARTBEAT_TIMED_OUT = 3 => Heartbeat::TimedOut,
    }
}

/// Number of a decision's reason; 0 if it has none.
pub(crate) fn decision_reason(decision: Decision) -> u8 {
    match decision {
        Decision::Wait(reason) => igh_cia402_wait_t::from(reason) as u8,
        Decision::Reject(rejection) => igh_cia402_rejection_t::from(rejection) as u8,
        _ => 0,
    }
}
