//! State of the axes

use std::ffi::{c_char, c_int};

use ecan_c_boundary::pointers;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_export::export;
use ecan_cia402::{AxisStatus, InputObject, Shutdown};

use super::context::{igh_cia402_context_t, need_axis};
use super::numbers::{igh_canopen_nmt_state_t, igh_cia402_drive_state_t};
use super::process_data::igh_cia402_input_t;
use super::state_terms::{
    decision_reason, igh_canopen_heartbeat_t, igh_cia402_axis_error_t, igh_cia402_decision_t,
    igh_cia402_hold_t, igh_cia402_phase_t, igh_cia402_stop_cause_t,
};

/// State of an axis.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_cia402_axis_state_t {
    /// Time in this phase, in milliseconds.
    pub for_ms: u64,
    /// Target minus actual position, in steps, if has_target and has_actual are 1. It contains the
    /// transport times, two cycles or more; the drive's own following error is in 0x60F4.
    pub following_error: i64,
    /// Actual position in radians, if has_actual is 1.
    pub actual_radians: f64,
    /// Last usable actual position, in steps, if has_actual is 1.
    pub actual: i32,
    /// Last sent target, if has_target is 1; the reference of the next one.
    pub target: i32,
    /// Actual velocity 0x606C; this and the next fields by `inputs`.
    pub velocity: i32,
    /// Following error 0x60F4 by the drive, in steps.
    pub drive_following_error: i32,
    /// Digital inputs 0x60FD.
    pub digital_inputs: u32,
    /// Velocity offset 0x60B1 that was sent last.
    pub velocity_offset: i32,
    /// Inputs with a value: sum of igh_cia402_input_t. A value is that of the last TPDO with the
    /// object since the configuration.
    pub inputs: u32,
    /// Age of the actual position in cycles: 0 for this cycle, 65535 for more or never.
    pub actual_age: u16,
    /// Last statusword of any age, if has_statusword is 1.
    pub statusword: u16,
    /// Error code of the last emergency message, 0x8611 for example; 0 for none, or after the node
    /// reset it.
    pub error_code: u16,
    /// Slave index of the gateway.
    pub slave: u16,
    /// Actual torque 0x6077, in thousandths of the rated torque.
    pub torque: i16,
    /// Torque offset 0x60B2 that was sent last.
    pub torque_offset: i16,
    /// Error code 0x603F in the TPDO.
    pub drive_error_code: u16,
    /// Touch probe status 0x60B9; igh_cia402_get_probe() has the positions.
    pub probe_status: u16,
    /// Actual velocity 0x6044 of VL.
    pub vl_velocity: i16,
    /// Channel of the gateway.
    pub channel: u8,
    /// Node-ID of the drive.
    pub node_id: u8,
    /// An igh_cia402_mode_t: the confirmed mode; before that, the mode of the axis table.
    pub mode: i8,
    /// An igh_cia402_phase_t.
    pub phase: u8,
    /// An igh_cia402_drive_state_t, by the last statusword.
    pub drive_state: u8,
    /// An igh_canopen_nmt_state_t.
    pub nmt_state: u8,
    /// An igh_canopen_heartbeat_t.
    pub heartbeat: u8,
    /// An igh_cia402_decision_t: decision on the last target.
    pub decision: u8,
    /// Reason of the decision: an igh_cia402_wait_t or igh_cia402_rejection_t; else 0.
    pub decision_reason: u8,
    /// An igh_cia402_hold_t: reason of the hold.
    pub hold_reason: u8,
    /// An igh_cia402_axis_error_t: error of the last command.
    pub axis_error: u8,
    /// 1 if the drive is configured.
    pub is_configured: u8,
    /// 1 if the axis follows the application's targets; 0 while it is halted.
    pub is_running: u8,
    /// 1 if a halted axis is at rest, and if it is not active.
    pub is_at_rest: u8,
    /// 1 if a drive with its own trajectory (PP, PV, PT) has reached the target; 0 in cyclic modes.
    pub is_target_reached: u8,
    /// 1 if there is an actual position.
    pub has_actual: u8,
    /// 1 if the axis follows targets and has one.
    pub has_target: u8,
    /// 1 if a statusword was received.
    pub has_statusword: u8,
    /// An igh_cia402_stop_cause_t: cause of the stop that is pending or complete.
    pub stop_cause: u8,
    /// 1 if the drive has stopped; see igh_cia402_all_stopped().
    pub is_stopped: u8,
    /// 1 while igh_cia402_recover() continues.
    pub is_recovering: u8,
    /// Mode display 0x6061, as the drive reports it in the TPDO.
    pub mode_display: i8,
    /// Zero; for fields of later versions.
    pub reserved: [u8; 28],
}

impl From<AxisStatus> for igh_cia402_axis_state_t {
    fn from(status: AxisStatus) -> Self {
        let (address, inputs) = (status.address, status.inputs);
        let has = |(mask, _, object): &(igh_cia402_input_t, &str, InputObject)| {
            inputs.get(*object).map(|_| *mask as u32)
        };
        Self {
            for_ms: u64::try_from(status.elapsed.as_millis()).unwrap_or(u64::MAX),
            following_error: status.following_error().unwrap_or(0),
            actual_radians: status.actual_radians().unwrap_or(0.0),
            actual: status.actual.unwrap_or(0),
            target: status.target.unwrap_or(0),
            velocity: inputs.velocity().unwrap_or(0),
            drive_following_error: inputs.following_error().unwrap_or(0),
            digital_inputs: inputs.digital_inputs().unwrap_or(0),
            velocity_offset: status.feed_forward.velocity,
            inputs: igh_cia402_input_t::PAIRS.iter().filter_map(has).sum(),
            actual_age: status.actual_age,
            statusword: status.statusword.map_or(0, |word| word.0),
            error_code: status.error_code,
            slave: u16::try_from(address.slave).unwrap_or(u16::MAX),
            // Its object has 16 bits.
            torque: inputs.torque().unwrap_or(0) as i16,
            torque_offset: status.feed_forward.torque,
            drive_error_code: inputs.error_code().unwrap_or(0),
            probe_status: inputs.probe_status().unwrap_or(0),
            // Likewise.
            vl_velocity: inputs.get(InputObject::VlVelocity).unwrap_or(0) as i16,
            channel: address.channel,
            node_id: address.node.get(),
            mode: status.mode.raw(),
            phase: igh_cia402_phase_t::from(status.phase) as u8,
            drive_state: igh_cia402_drive_state_t::from(status.drive_state()) as u8,
            nmt_state: igh_canopen_nmt_state_t::from(status.nmt_state) as u8,
            heartbeat: igh_canopen_heartbeat_t::from(status.heartbeat) as u8,
            decision: igh_cia402_decision_t::from(status.decision) as u8,
            decision_reason: decision_reason(status.decision),
            hold_reason: igh_cia402_hold_t::from(status.hold_reason) as u8,
            axis_error: igh_cia402_axis_error_t::from(status.error) as u8,
            is_configured: status.is_configured.into(),
            is_running: status.is_running.into(),
            is_at_rest: status.is_at_rest.into(),
            is_target_reached: status.is_target_reached.into(),
            has_actual: status.actual.is_some().into(),
            has_target: status.target.is_some().into(),
            has_statusword: status.statusword.is_some().into(),
            stop_cause: igh_cia402_stop_cause_t::from(status.stop_cause) as u8,
            is_stopped: status.is_stopped.into(),
            is_recovering: status.is_recovering.into(),
            mode_display: inputs.mode_display().unwrap_or(0),
            reserved: [0; 28],
        }
    }
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
    need_axis(call, cia402, axis)?;
    cia402.axis_status(axis).map(Into::into).ok_or(ecan_result_t::ECAN_ERR_INTERNAL)
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
    need_axis(call, cia402, axis)?;
    let progress = cia402.progress(axis).ok_or(ecan_result_t::ECAN_ERR_INTERNAL)?;
    text.put(call, &progress.to_string())
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
