//! State and counters of axes.

use std::ffi::{c_char, c_int};

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{mirror, pointers};
use ecan_c_export::export;
use ecan_canopen::Heartbeat;
use ecan_cia402::{
    AxisErrorKind, AxisInputs, AxisPhase, AxisStatistics, AxisStatus, BusLoad, Decision,
    HoldReason, InputObject, LoadWarning, Shutdown, StopCause, TargetRejection, WaitReason,
};

use super::context::{igh_cia402_context_t, need_axis};
use super::cycle::igh_cia402_input_t;
use super::numbers::{igh_canopen_nmt_state_t, igh_cia402_drive_state_t};

// Section: State of the axes

mirror! {
    /// State of an axis.
    pub struct igh_cia402_axis_state_t from rust: AxisStatus {
        /// Time in this phase, in milliseconds.
        for_ms: u64 = u64::try_from(rust.elapsed.as_millis()).unwrap_or(u64::MAX),
        /// Target minus actual position, in steps, if has_target and has_actual are 1. It contains the
        /// transport times, two cycles or more; the drive's own following error is in 0x60F4.
        following_error: i64 = rust.following_error().unwrap_or(0),
        /// Actual position in radians, if has_actual is 1.
        actual_radians: f64 = rust.actual_radians().unwrap_or(0.0),
        /// Last usable actual position, in steps, if has_actual is 1.
        actual: i32 = rust.actual.unwrap_or(0),
        /// Last sent target, if has_target is 1; the reference of the next one.
        target: i32 = rust.target.unwrap_or(0),
        /// Actual velocity 0x606C; this and the next fields by `inputs`.
        velocity: i32 = rust.inputs.velocity().unwrap_or(0),
        /// Following error 0x60F4 by the drive, in steps.
        drive_following_error: i32 = rust.inputs.following_error().unwrap_or(0),
        /// Digital inputs 0x60FD.
        digital_inputs: u32 = rust.inputs.digital_inputs().unwrap_or(0),
        /// Velocity offset 0x60B1 that was sent last.
        velocity_offset: i32 = rust.feed_forward.velocity,
        /// Inputs with a value: sum of igh_cia402_input_t. A value is that of the last TPDO with the
        /// object since the configuration.
        inputs: u32 = inputs_with_value(&rust.inputs),
        /// Age of the actual position in cycles: 0 for this cycle, 65535 for more or never.
        actual_age: u16,
        /// Last statusword of any age, if has_statusword is 1.
        statusword: u16 = rust.statusword.map_or(0, |word| word.0),
        /// Error code of the last emergency message, 0x8611 for example; 0 for none, or after the node
        /// reset it.
        error_code: u16,
        /// Slave index of the gateway.
        slave: u16 = u16::try_from(rust.address.slave).unwrap_or(u16::MAX),
        /// Actual torque 0x6077, in thousandths of the rated torque.
        // Its object has 16 bits.
        torque: i16 = rust.inputs.torque().unwrap_or(0) as i16,
        /// Torque offset 0x60B2 that was sent last.
        torque_offset: i16 = rust.feed_forward.torque,
        /// Error code 0x603F in the TPDO.
        drive_error_code: u16 = rust.inputs.error_code().unwrap_or(0),
        /// Touch probe status 0x60B9; igh_cia402_get_probe() has the positions.
        probe_status: u16 = rust.inputs.probe_status().unwrap_or(0),
        /// Actual velocity 0x6044 of VL.
        // Its object has 16 bits.
        vl_velocity: i16 = rust.inputs.get(InputObject::VlVelocity).unwrap_or(0) as i16,
        /// Channel of the gateway.
        channel: u8 = rust.address.channel,
        /// Node-ID of the drive.
        node_id: u8 = rust.address.node.get(),
        /// An igh_cia402_mode_t: the confirmed mode; before that, the mode of the axis table.
        mode: i8 = rust.mode.raw(),
        /// An igh_cia402_phase_t.
        phase: u8 = igh_cia402_phase_t::from(rust.phase) as u8,
        /// An igh_cia402_drive_state_t, by the last statusword.
        drive_state: u8 = igh_cia402_drive_state_t::from(rust.drive_state()) as u8,
        /// An igh_canopen_nmt_state_t.
        nmt_state: u8 = igh_canopen_nmt_state_t::from(rust.nmt_state) as u8,
        /// An igh_canopen_heartbeat_t.
        heartbeat: u8 = igh_canopen_heartbeat_t::from(rust.heartbeat) as u8,
        /// An igh_cia402_decision_t: decision on the last target.
        decision: u8 = igh_cia402_decision_t::from(rust.decision) as u8,
        /// Reason of the decision: an igh_cia402_wait_t or igh_cia402_rejection_t; else 0.
        decision_reason: u8 = decision_reason(rust.decision),
        /// An igh_cia402_hold_t: reason of the hold.
        hold_reason: u8 = igh_cia402_hold_t::from(rust.hold_reason) as u8,
        /// An igh_cia402_axis_error_t: error of the last command.
        axis_error: u8 = igh_cia402_axis_error_t::from(rust.error) as u8,
        /// 1 if the drive is configured.
        is_configured: u8,
        /// 1 if the axis follows the application's targets; 0 while it is halted.
        is_running: u8,
        /// 1 if a halted axis is at rest, and if it is not active.
        is_at_rest: u8,
        /// 1 if a drive with its own trajectory (PP, PV, PT) has reached the target; 0 in cyclic modes.
        is_target_reached: u8,
        /// 1 if there is an actual position.
        has_actual: u8 = rust.actual.is_some().into(),
        /// 1 if the axis follows targets and has one.
        has_target: u8 = rust.target.is_some().into(),
        /// 1 if a statusword was received.
        has_statusword: u8 = rust.statusword.is_some().into(),
        /// An igh_cia402_stop_cause_t: cause of the stop that is pending or complete.
        stop_cause: u8 = igh_cia402_stop_cause_t::from(rust.stop_cause) as u8,
        /// 1 if the drive has stopped; see igh_cia402_all_stopped().
        is_stopped: u8,
        /// 1 while igh_cia402_recover() continues.
        is_recovering: u8,
        /// Mode display 0x6061, as the drive reports it in the TPDO.
        mode_display: i8 = rust.inputs.mode_display().unwrap_or(0),
        /// Zero; for fields of later versions.
        reserved: [u8; 28] = [0; 28],
    }
}

/// Inputs with a value: a sum.
fn inputs_with_value(inputs: &AxisInputs) -> u32 {
    let pairs = igh_cia402_input_t::PAIRS.iter();
    pairs
        .filter(|(_, _, object)| inputs.get(*object).is_some())
        .map(|(mask, ..)| *mask as u32)
        .sum()
}

/// Gets the state of an axis.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _), into axis_state)]
pub fn igh_cia402_get_axis_state(
    context: *mut igh_cia402_context_t,
    axis: usize,
    axis_state: *mut igh_cia402_axis_state_t,
) {
    Ok(need_axis(call, cia402, axis)?.status().into())
}

/// Gets the state of an axis as text, with its time and the reason if it does not continue: "axis
/// 2, node 5 (slave 0, channel 1): being enabled, switched on, for 120 ms" for example.
///
/// @param text  See the rules for texts in igh_ecan_common.h.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_BUFFER.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_get_axis_text(
    context: *mut igh_cia402_context_t,
    axis: usize,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(text, size, needed));
    text.put(call, &need_axis(call, cia402, axis)?.progress().to_string())
}

/// Returns 1 if all axes follow the application's targets; 0 while one is halted.
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0, also 0 without any axis; 0 after an error, which ecan_last_error_code() gives.
#[export(_, layer(cia402, _), or 0)]
pub fn igh_cia402_all_running(context: *mut igh_cia402_context_t) -> c_int {
    Ok(cia402.all_running().into())
}

/// Returns 1 if all axes have stopped: every drive reported that it is off or at rest after a quick
/// stop, or never reported anything and is not being configured.
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
#[export(_, layer(cia402, _), or 0)]
pub fn igh_cia402_all_stopped(context: *mut igh_cia402_context_t) -> c_int {
    Ok(cia402.all_stopped().into())
}

/// Returns 1 if the shutdown of igh_cia402_begin_shutdown() is complete, and the host may exit.
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
#[export(_, layer(cia402, _), or 0)]
pub fn igh_cia402_shutdown_is_done(context: *mut igh_cia402_context_t) -> c_int {
    let is_done = cia402.shutdown_state() == Shutdown::Done;
    // The last commands must have left before the host does.
    Ok((is_done && !cia402.network().nmt_is_pending()).into())
}

// Section: Values of an axis' state

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

// Section: Counters and bus load
//
// Counters only grow.

mirror! {
    /// Counters of an axis.
    pub struct igh_cia402_axis_statistics_t from rust: AxisStatistics {
        /// Targets passed to the gateway, the first ones included.
        targets_sent: u64,
        /// Times that the axis became active while enabled.
        activations: u64,
        /// Rejected targets of the application, for any reason.
        targets_rejected: u64,
        /// Targets rejected because of the step limit.
        rejected_step: u64,
        /// Targets rejected because of the following window.
        rejected_window: u64,
        /// Cycles in which an active axis got no target: an incomplete working counter, a repeated
        /// image, a full image.
        waits: u64,
        /// Times that the axis held.
        holds: u64,
        /// Times that the axis became uncontrolled: to be stopped, possibly moving, and silent.
        uncontrolled: u64,
        /// TPDOs received.
        tpdos: u64,
        /// TPDOs too short for the mapping.
        malformed_tpdos: u64,
        /// Lost TPDOs, by the number of sent SYNCs.
        lost_tpdos: u64,
        /// Cycles with an actual position that cannot be used: in an incomplete image, after a
        /// backlog.
        unusable_positions: u64,
        /// Largest distance between target and actual position while targets were sent, in steps.
        max_following_error: u64,
        /// Targets that the gateway reported as not sent.
        targets_lost: u64,
        /// Feed-forwards that a limit changed.
        feed_forwards_limited: u64,
        /// Faults of the drive.
        faults: u64,
        /// Emergency messages.
        emergencies: u32,
        /// Most consecutive cycles without a usable TPDO while the axis was enabled.
        longest_gap: u16,
        /// An igh_cia402_hold_t: reason of the last hold.
        last_hold: u8 = igh_cia402_hold_t::from(rust.last_hold) as u8,
        /// Zero.
        padding: u8 = 0,
        /// Zero; for fields of later versions.
        reserved: [u64; 8] = [0; 8],
    }
}

mirror! {
    /// Overload of a channel.
    pub enum igh_cia402_load_warning_t from Option<LoadWarning> {
        /// No overload.
        IGH_CIA402_LOAD_OK = 0 => None,
        /// Less than 10 % is left for SDO, heartbeats and emergencies.
        IGH_CIA402_LOAD_NO_RESERVE = 1 => Some(LoadWarning::NoReserve),
        /// In the worst case of stuff bits the bus is too slow for a cycle.
        IGH_CIA402_LOAD_TIGHT = 2 => Some(LoadWarning::Tight),
        /// More frames in a cycle than the gateway serves in one direction.
        IGH_CIA402_LOAD_BUDGET = 3 => Some(LoadWarning::Budget),
        /// The bus is too slow for the cycle: targets accumulate, and the axes will hold.
        IGH_CIA402_LOAD_TOO_MUCH = 4 => Some(LoadWarning::TooMuch),
    }
}

mirror! {
    /// Load of one channel by the process data of its axes and SYNC. SDO, heartbeats and NMT use
    /// the rest.
    pub struct igh_cia402_bus_load_t from rust: BusLoad {
        /// Share of the bus without stuff bits; 1.0 is 100 %.
        least: f64,
        /// Share of the bus with the most possible stuff bits.
        most: f64,
        /// Axes on the channel.
        axes: u32,
        /// Frames from the host per cycle.
        frames_out: u32,
        /// Frames from the drives per cycle.
        frames_in: u32,
        /// Slave index.
        slave: u16 = u16::try_from(rust.slave).unwrap_or(u16::MAX),
        /// Channel, 0 to 3.
        channel: u8,
        /// An igh_cia402_load_warning_t.
        warning: u8 = igh_cia402_load_warning_t::from(rust.warning()) as u8,
        /// Zero; for fields of later versions.
        reserved: [u64; 4] = [0; 4],
    }
}

/// Counters of an axis.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _), into statistics)]
pub fn igh_cia402_get_axis_statistics(
    context: *mut igh_cia402_context_t,
    axis: usize,
    statistics: *mut igh_cia402_axis_statistics_t,
) {
    Ok(need_axis(call, cia402, axis)?.statistics().into())
}

/// Gets the load of each CAN bus with axes by process data, by the bit rates of the Port.
///
/// @param loads     Gets the loads of the channels.
/// @param capacity  Channels that fit.
/// @param count     Gets the number of channels with axes, even if they do not all fit.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_BUFFER if not all fit.
#[export(call, layer(cia402, port))]
pub fn igh_cia402_get_bus_load(
    context: *mut igh_cia402_context_t,
    loads: *mut igh_cia402_bus_load_t,
    capacity: usize,
    count: *mut usize,
) {
    pointers!(call, room(loads, capacity), out(count));
    let found = cia402.bus_load(port);
    count.set(found.len());
    if found.iter().all(|load| loads.push((*load).into())) {
        return Ok(());
    }
    let text = format_args!("{} channels have axes, {capacity} fit", found.len());
    Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text))
}
