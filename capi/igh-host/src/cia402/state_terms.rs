//! What the state of an axis is made of

use ecan_canopen::Heartbeat;
use ecan_cia402::{AxisError, AxisPhase, Decision, HoldReason, TargetRejection, WaitReason};
use ecan_mcan_host::mirror;

mirror! {
    /// What an axis is doing.
    pub enum igh_cia402_phase_t from AxisPhase {
        /// Not configured yet, or not any more: the drive restarted.
        IGH_CIA402_PHASE_NOT_CONFIGURED = 0 => AxisPhase::NotConfigured,
        /// The steps of its configuration are being done.
        IGH_CIA402_PHASE_CONFIGURING = 1 => AxisPhase::Configuring,
        /// Its mode is written and waited for.
        IGH_CIA402_PHASE_SETTING_MODE = 2 => AxisPhase::SettingMode(_),
        /// Its configuration failed.
        IGH_CIA402_PHASE_SETUP_FAILED = 3 => AxisPhase::SetupFailed,
        /// Configured; nothing is commanded.
        IGH_CIA402_PHASE_STANDBY = 4 => AxisPhase::Standby,
        /// Its actual position is being established.
        IGH_CIA402_PHASE_READING = 5 => AxisPhase::Reading(..),
        /// Its actual position is known; the drive is not enabled.
        IGH_CIA402_PHASE_READY = 6 => AxisPhase::Ready,
        /// The drive is brought to Operation Enabled.
        IGH_CIA402_PHASE_ENABLING = 7 => AxisPhase::Enabling(_),
        /// Follows targets.
        IGH_CIA402_PHASE_RUNNING = 8 => AxisPhase::Running,
        /// Is being brought to rest, or was, by igh_cia402_halt().
        IGH_CIA402_PHASE_HALTED = 9 => AxisPhase::Halted,
        /// Gets no targets until it is taken up again; hold_reason says why.
        IGH_CIA402_PHASE_HOLDING = 10 => AxisPhase::Holding(_),
        /// A quick stop was commanded.
        IGH_CIA402_PHASE_QUICK_STOP = 11 => AxisPhase::QuickStop,
        /// The drive's power is being switched off.
        IGH_CIA402_PHASE_DISABLING = 12 => AxisPhase::Disabling,
        /// A fault is being reset.
        IGH_CIA402_PHASE_RESETTING_FAULT = 13 => AxisPhase::ResettingFault,
        /// The drive has a fault.
        IGH_CIA402_PHASE_FAULT = 14 => AxisPhase::Fault,
        /// The mode is being changed.
        IGH_CIA402_PHASE_CHANGING_MODE = 15 => AxisPhase::ChangingMode(_),
        /// Homing is prepared or wound up.
        IGH_CIA402_PHASE_PREPARING_HOMING = 16 => AxisPhase::PreparingHoming,
        /// Homing.
        IGH_CIA402_PHASE_HOMING = 17 => AxisPhase::Homing(_),
        /// Another one.
        IGH_CIA402_PHASE_OTHER = 255 => _,
    }
}

mirror! {
    /// What became of an axis' target.
    pub enum igh_cia402_decision_t from Decision {
        /// The axis is not taken up, or holds: no target.
        IGH_CIA402_DECISION_CLOSED = 0 => Decision::Closed,
        /// The drive is not enabled: it got its own actual position.
        IGH_CIA402_DECISION_TRACK = 1 => Decision::Track(_),
        /// The first target of an enabled drive: its actual position.
        IGH_CIA402_DECISION_FIRST = 2 => Decision::First(_),
        /// The application's target went out, or the last one again where it gave none.
        IGH_CIA402_DECISION_TARGET = 3 => Decision::Target(_),
        /// Nothing now; decision_reason is an igh_cia402_wait_t.
        IGH_CIA402_DECISION_WAIT = 4 => Decision::Wait(_),
        /// Not this target; decision_reason is an igh_cia402_refusal_t.
        IGH_CIA402_DECISION_REFUSED = 5 => Decision::Reject(_),
    }
}

mirror! {
    /// Why an axis that is taken up got nothing in a cycle. Its motion must not go on meanwhile.
    pub enum igh_cia402_wait_t from WaitReason {
        /// The working counter of this cycle is incomplete.
        IGH_CIA402_WAIT_WORKING_COUNTER = 1 => WaitReason::WorkingCounter,
        /// The last image may not have arrived and is repeated.
        IGH_CIA402_WAIT_IMAGE_HELD = 2 => WaitReason::ImageUnconfirmed,
        /// The first target must be an actual position of this very cycle, and there is none.
        IGH_CIA402_WAIT_NO_FRESH_POSITION = 3 => WaitReason::NoFreshPosition,
        /// The drive still holds an old target, far from the axis: it must be switched off first.
        IGH_CIA402_WAIT_HOLDS_OLD_TARGET = 4 => WaitReason::HoldsOldTarget,
        /// The image of the last cycle had no room for a frame of the channel.
        IGH_CIA402_WAIT_IMAGE_FULL = 5 => WaitReason::ImageFull,
        /// This cycle has had its target.
        IGH_CIA402_WAIT_SPENT = 6 => WaitReason::Spent,
        /// A frame was refused in this cycle; the axis will hold.
        IGH_CIA402_WAIT_FRAME_REFUSED = 7 => WaitReason::Rejected,
    }
}

mirror! {
    /// Why a target was not taken. The target before it stands.
    pub enum igh_cia402_refusal_t from TargetRejection {
        /// Too far from the target before.
        IGH_CIA402_REFUSAL_STEP = 1 => TargetRejection::Step { .. },
        /// Too far from the actual position.
        IGH_CIA402_REFUSAL_WINDOW = 2 => TargetRejection::Window { .. },
        /// Outside the bounds of the axis.
        IGH_CIA402_REFUSAL_BOUNDS = 3 => TargetRejection::Bounds { .. },
        /// The position counter cannot stand there.
        IGH_CIA402_REFUSAL_COUNTER = 4 => TargetRejection::Counter { .. },
        /// The mode takes no targets.
        IGH_CIA402_REFUSAL_NO_TARGETS = 5 => TargetRejection::NoTargets,
        /// Another reason.
        IGH_CIA402_REFUSAL_OTHER = 255 => _,
    }
}

mirror! {
    /// Why an axis holds: it gets no targets until igh_cia402_enable().
    pub enum igh_cia402_hold_t from Option<HoldReason> {
        /// It does not hold.
        IGH_CIA402_HOLD_NONE = 0 => None,
        /// The gateway went out of service.
        IGH_CIA402_HOLD_GATEWAY_LOST = 1 => Some(HoldReason::GatewayLost),
        /// Frames under way to the gateway were given up, a target may be among them.
        IGH_CIA402_HOLD_FRAMES_DISCARDED = 2 => Some(HoldReason::FramesDiscarded),
        /// The working counter stayed incomplete for longer than wc_misses.
        IGH_CIA402_HOLD_WORKING_COUNTER = 3 => Some(HoldReason::WorkingCounter),
        /// The channel went bus-off.
        IGH_CIA402_HOLD_BUS_OFF = 4 => Some(HoldReason::BusOff),
        /// The channel left the bus without being bus-off.
        IGH_CIA402_HOLD_CHANNEL_STOPPED = 5 => Some(HoldReason::ChannelStopped),
        /// The gateway's transmit queue was full.
        IGH_CIA402_HOLD_QUEUE_FULL = 6 => Some(HoldReason::QueueFull),
        /// The gateway reported a target as not sent.
        IGH_CIA402_HOLD_TARGET_LOST = 7 => Some(HoldReason::TargetLost),
        /// The drive's heartbeat stayed away.
        IGH_CIA402_HOLD_HEARTBEAT_LOST = 8 => Some(HoldReason::HeartbeatLost),
        /// The drive is not Operational, or restarted.
        IGH_CIA402_HOLD_NOT_OPERATIONAL = 9 => Some(HoldReason::NotOperational),
        /// The drive was out of sight, and its configuration is being verified.
        IGH_CIA402_HOLD_UNVERIFIED = 10 => Some(HoldReason::Unverified),
        /// No usable TPDO came for longer than tpdo_timeout.
        IGH_CIA402_HOLD_TPDO_LOST = 11 => Some(HoldReason::TpdoLost(_)),
        /// The drive left Operation Enabled.
        IGH_CIA402_HOLD_LEFT_OPERATION_ENABLED = 12 => Some(HoldReason::LeftOperationEnabled(_)),
        /// The drive stopped following its target.
        IGH_CIA402_HOLD_NOT_FOLLOWING = 13 => Some(HoldReason::NotFollowing),
        /// The drive reports a following error.
        IGH_CIA402_HOLD_FOLLOWING_ERROR = 14 => Some(HoldReason::FollowingError),
        /// The axis moved while it was to be taken up.
        IGH_CIA402_HOLD_MOVING = 15 => Some(HoldReason::Moving),
        /// The application commanded it.
        IGH_CIA402_HOLD_COMMANDED = 16 => Some(HoldReason::Commanded),
        /// Another reason.
        IGH_CIA402_HOLD_OTHER = 255 => Some(_),
    }
}

mirror! {
    /// What went wrong with the last command to an axis; igh_cia402_get_axis_text() tells more.
    pub enum igh_cia402_axis_error_t from Option<AxisError> {
        /// Nothing.
        IGH_CIA402_AXIS_ERROR_NONE = 0 => None,
        /// The configuration failed.
        IGH_CIA402_AXIS_ERROR_SETUP = 1 => Some(AxisError::Setup(_)),
        /// The drive restarted and has forgotten its configuration.
        IGH_CIA402_AXIS_ERROR_RESTARTED = 2 => Some(AxisError::Restarted),
        /// The drive did not reach Operation Enabled in time.
        IGH_CIA402_AXIS_ERROR_ENABLE_TIMED_OUT = 3 => Some(AxisError::EnableTimedOut { .. }),
        /// The drive has a fault; error_code.
        IGH_CIA402_AXIS_ERROR_FAULT = 4 => Some(AxisError::Fault { .. }),
        /// The drive stays in fault after a reset; error_code.
        IGH_CIA402_AXIS_ERROR_RESET_REFUSED = 5 => Some(AxisError::ResetFailed { .. }),
        /// The axis held; hold_reason.
        IGH_CIA402_AXIS_ERROR_HELD = 6 => Some(AxisError::Held(_)),
        /// Homing ended without a home position.
        IGH_CIA402_AXIS_ERROR_HOMING = 7 => Some(AxisError::Homing(_)),
        /// Homing took too long.
        IGH_CIA402_AXIS_ERROR_HOMING_TIMED_OUT = 8 => Some(AxisError::HomingTimedOut { .. }),
        /// A mode was not taken.
        IGH_CIA402_AXIS_ERROR_MODE = 9 => Some(AxisError::Mode(_)),
        /// The drive did not switch its power off in time.
        IGH_CIA402_AXIS_ERROR_NOT_DISABLED = 10 => Some(AxisError::NotDisabled { .. }),
        /// Another one.
        IGH_CIA402_AXIS_ERROR_OTHER = 255 => Some(_),
    }
}

mirror! {
    /// How a node's heartbeat stands.
    pub enum igh_canopen_heartbeat_t from Heartbeat {
        /// It is not watched.
        IGH_CANOPEN_HEARTBEAT_UNWATCHED = 0 => Heartbeat::Unconfigured,
        /// It has not been heard since watching began or the node booted.
        IGH_CANOPEN_HEARTBEAT_UNKNOWN = 1 => Heartbeat::Unknown,
        /// It comes in time.
        IGH_CANOPEN_HEARTBEAT_ACTIVE = 2 => Heartbeat::Active,
        /// It stayed away.
        IGH_CANOPEN_HEARTBEAT_TIMED_OUT = 3 => Heartbeat::TimedOut,
    }
}

/// Number of a decision's reason; 0 if it has none.
pub(crate) fn decision_reason(decision: Decision) -> u8 {
    match decision {
        Decision::Wait(reason) => igh_cia402_wait_t::from(reason) as u8,
        Decision::Reject(rejection) => igh_cia402_refusal_t::from(rejection) as u8,
        _ => 0,
    }
}
