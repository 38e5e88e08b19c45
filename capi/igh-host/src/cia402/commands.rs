//! Commands to axes: calls that start an operation, and calls that wait for all axes.

use std::ffi::{c_char, c_int, c_void};

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_cia402::{
    AxisCommand, Blocking, Cia402, Cia402Error, CommandError, HomingConfig, StopKind,
};

use super::context::{igh_cia402_context_t, need_axis};
use super::numbers;
use crate::bus::Bus;
use crate::callback::{ProgressCallback, duration, milliseconds};
use crate::errors::OrCode as _;
use crate::handle::Entered;

// Section: Commands to axes
//
// Each call starts an operation and returns; the cycle continues it, and
// igh_cia402_get_axis_state() reports the progress. With IGH_CIA402_ALL_AXES a command goes to every
// axis, even after one that rejects it; the code is that of the first rejection.

/// In place of the index of an axis in igh_cia402_configure(), _request_actual_position(), _enable(),
/// _disable(), _quick_stop(), _recover(), _reset_fault(), _halt() and _resume(): all axes.
pub const IGH_CIA402_ALL_AXES: usize = 0xFFFF_FFFF;

/// Gives a command to an axis, or to all.
fn command(cia402: &mut Cia402, axis: usize, command: AxisCommand) -> Result<(), CommandError> {
    match axis {
        IGH_CIA402_ALL_AXES => cia402.command_all(command),
        axis => cia402.axis_mut(axis)?.command(command),
    }
}

/// Sends an NMT command to all nodes of the channels with axes, with the next targets. After any
/// command except IGH_CANOPEN_NMT_START the axes hold. The configuration of a drive sends the
/// commands that it needs.
///
/// @param command  An igh_canopen_nmt_t.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_CANOPEN if the command queue is full; ECAN_ERR_ARGUMENT.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_send_nmt_all(context: *mut igh_cia402_context_t, command: c_int) {
    cia402.send_nmt_all(numbers::nmt_command(call, command)?).or_code(call)
}

/// Sends an NMT command to the drive of an axis, as igh_cia402_send_nmt_all().
///
/// @param command  An igh_canopen_nmt_t.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_send_nmt_all(); ECAN_ERR_AXIS.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_send_nmt(context: *mut igh_cia402_context_t, axis: usize, command: c_int) {
    let command = numbers::nmt_command(call, command)?;
    let node = need_axis(call, cia402, axis)?.node();
    cia402.network_mut().nmt(node, command).or_code(call)
}

/// Starts configuring a drive, even if it is configured: after a restart, for example. An enabled
/// drive is disabled first. With IGH_CIA402_ALL_AXES only drives that are not configured.
/// igh_cia402_configure_csp_all_timeout() also waits.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_AXIS_STATE, ECAN_ERR_AXIS.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_configure(context: *mut igh_cia402_context_t, axis: usize) {
    command(cia402, axis, AxisCommand::Configure).or_code(call)
}

/// Starts determining the actual position of an axis: waits for pending frames, then for fresh TPDOs
/// at rest. igh_cia402_request_actual_position_all_timeout() also waits.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_AXIS_STATE for an axis that is not configured, changes its mode or
///          is homing; ECAN_ERR_AXIS.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_request_actual_position(context: *mut igh_cia402_context_t, axis: usize) {
    command(cia402, axis, AxisCommand::ReadPosition).or_code(call)
}

/// Starts enabling all drives and activating axes that hold; active axes continue. The same as
/// igh_cia402_enable() with IGH_CIA402_ALL_AXES, under the manual's name (15.5.4).
/// igh_cia402_enable_all_timeout() also waits.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_request_actual_position().
#[export(call, layer(cia402, _))]
pub fn igh_cia402_enable_all(context: *mut igh_cia402_context_t) {
    cia402.command_all(AxisCommand::Enable).or_code(call)
}

/// Starts enabling a drive, or activating an axis that holds: its actual position is determined and
/// is its first target. A drive in fault is not enabled: call igh_cia402_reset_fault() first. After
/// enable_timeout_ms the drive is disabled again.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_request_actual_position().
#[export(call, layer(cia402, _))]
pub fn igh_cia402_enable(context: *mut igh_cia402_context_t, axis: usize) {
    command(cia402, axis, AxisCommand::Enable).or_code(call)
}

/// Stops targets at once and disables a drive; 0x605C determines how it stops. igh_cia402_halt()
/// brings it to rest before.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _))]
pub fn igh_cia402_disable(context: *mut igh_cia402_context_t, axis: usize) {
    command(cia402, axis, AxisCommand::Stop(StopKind::Disable)).or_code(call)
}

/// Brings all axes to rest and keeps them enabled, the CSP axes together on their path; targets are
/// ignored until igh_cia402_resume().
///
/// The active CSP axes continue straight in the direction of their last targets and decelerate by
/// one profile that keeps the acceleration and jerk limits of every axis. If one of them holds, leaves
/// Operation enabled, is resumed or cannot move on, the others stop by their own ramps. All other
/// axes stop as by igh_cia402_halt().
///
/// @usage   rt, the cycle's thread, after init
#[export(_, layer(cia402, _))]
pub fn igh_cia402_stop_together(context: *mut igh_cia402_context_t) {
    cia402.stop_together();
}

/// Stops targets at once and commands a quick stop, as 0x605A of the drive determines; the drive of
/// an axis that is not configured is switched off at rest. igh_cia402_enable() activates the axis
/// again.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _))]
pub fn igh_cia402_quick_stop(context: *mut igh_cia402_context_t, axis: usize) {
    command(cia402, axis, AxisCommand::Stop(StopKind::QuickStop)).or_code(call)
}

/// Stops all axes as fast as their drives can, by quick stop, and disables the drives when they are
/// at rest. Acts on axes in every state. igh_cia402_all_stopped() reports the result.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _))]
pub fn igh_cia402_stop_all(context: *mut igh_cia402_context_t) {
    cia402.command_all(AxisCommand::Stop(StopKind::QuickStopThenDisable)).or_code(call)
}

/// Starts bringing an axis back to its targets, from a hold, a stop, a fault or a lost configuration,
/// and from the very beginning: waits for a pending stop, configures, resets a fault, enables, and
/// resumes a halted axis. Any other command to the axis ends it. It ends without success, with
/// axis_error, if a fault persists after one reset or another one follows, if the configuration
/// fails twice, if the drive does not answer and may be moving, or if enabling fails three times.
/// igh_cia402_recover_all_timeout() also waits.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_AXIS_STATE during a change of mode, homing or shutdown; ECAN_ERR_AXIS.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_recover(context: *mut igh_cia402_context_t, axis: usize) {
    command(cia402, axis, AxisCommand::Recover).or_code(call)
}

/// Resets the fault of a drive. Does not enable it, and does nothing if the drive has no fault.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_request_actual_position().
#[export(call, layer(cia402, _))]
pub fn igh_cia402_reset_fault(context: *mut igh_cia402_context_t, axis: usize) {
    command(cia402, axis, AxisCommand::ResetFault).or_code(call)
}

/// Brings an active axis to rest and keeps it enabled: in CSP by its ramp, in CSV and CST by
/// reducing the target to 0 in steps of the limit, in PP, PV and PT by the halt bit. Targets are
/// ignored until igh_cia402_resume().
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _))]
pub fn igh_cia402_halt(context: *mut igh_cia402_context_t, axis: usize) {
    command(cia402, axis, AxisCommand::Halt).or_code(call)
}

/// Lets a halted axis follow targets again.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _))]
pub fn igh_cia402_resume(context: *mut igh_cia402_context_t, axis: usize) {
    command(cia402, axis, AxisCommand::Resume).or_code(call)
}

/// Starts changing the mode of a drive, confirmed by its mode display. An active axis is brought to
/// rest and disabled before, and enabled again after the change. A hold while it comes to
/// rest ends the change, and the drive stays disabled.
///
/// @param mode  An igh_cia402_mode_t whose target is in the mapped process data of the axis; not
///              homing, which igh_cia402_home() does.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_request_actual_position(), ECAN_ERR_AXIS_STATE also for a mode that
///          is not mapped; ECAN_ERR_ARGUMENT.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_change_mode(context: *mut igh_cia402_context_t, axis: usize, mode: c_int) {
    let mode = numbers::mode(call, mode)?;
    cia402.axis_mut(axis).or_code(call)?.change_mode(mode).or_code(call)
}

mirror! {
    /// Homing of an axis. igh_cia402_homing_init() fills it. Objects that a drive does not have are
    /// skipped, except the method.
    #[derive(PartialEq, Eq)]
    pub struct igh_cia402_homing_t from rust: HomingConfig {
        /// Speed during search for the switch, 0x6099:01, in the drive's units; 0 does not write
        /// it.
        switch_speed: u32 = rust.switch_speed.unwrap_or(0),
        /// Speed during search for zero, 0x6099:02; 0 does not write it.
        zero_speed: u32 = rust.zero_speed.unwrap_or(0),
        /// Acceleration, 0x609A; 0 does not write it.
        acceleration: u32 = rust.acceleration.unwrap_or(0),
        /// Home offset, 0x607C, in steps, if has_offset is 1.
        offset: i32 = rust.offset.unwrap_or(0),
        /// Timeout in milliseconds. Default 60000.
        timeout_ms: u32 = milliseconds(rust.timeout),
        /// Homing method, 0x6098: 35 and 37 use the present position as home, 1 to 34 search for
        /// switches and index pulses, negative ones are the manufacturer's.
        method: i8,
        /// 1: the offset is written. Default 0.
        has_offset: u8 = rust.offset.is_some().into(),
        /// Must be 0; for fields of later versions.
        reserved: [u8; 26] = [0; 26],
    }
}

impl From<&igh_cia402_homing_t> for HomingConfig {
    fn from(from: &igh_cia402_homing_t) -> Self {
        let given = |value: u32| (value != 0).then_some(value);
        Self {
            method: from.method,
            switch_speed: given(from.switch_speed),
            zero_speed: given(from.zero_speed),
            acceleration: given(from.acceleration),
            offset: (from.has_offset != 0).then_some(from.offset),
            timeout: duration(from.timeout_ms),
        }
    }
}

/// Fills a homing: a method with the drive's own speeds, and a timeout of one minute.
///
/// @param homing  Is overwritten.
/// @param method  Homing method, 0x6098.
///
/// @usage   rt, any thread, any time
#[export(call)]
pub fn igh_cia402_homing_init(homing: *mut igh_cia402_homing_t, method: i8) {
    pointers!(call, out(homing));
    homing.set(HomingConfig::new(method).into());
}

/// Starts homing: rest, disable, parameters and mode, enable, homing, disable, the previous mode,
/// and enable again if it was enabled. The axis then becomes active at the position of its counter.
/// A hold before the drive is disabled ends the homing.
///
/// @param homing  Is copied.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_request_actual_position().
#[export(call, layer(cia402, _))]
pub fn igh_cia402_home(
    context: *mut igh_cia402_context_t,
    axis: usize,
    homing: *const igh_cia402_homing_t,
) {
    pointers!(call, read(homing));
    call.reserved("homing", &homing.reserved)?;
    cia402.axis_mut(axis).or_code(call)?.home(homing.into()).or_code(call)
}

/// Starts an orderly shutdown: every axis comes to rest by its ramp and is disabled and released,
/// so that no drive reports a fault when the host exits. Continue the cycle until
/// igh_cia402_shutdown_is_done(). A stage that an axis cannot finish ends after five seconds.
///
/// @usage   rt, the cycle's thread, after init
#[export(_, layer(cia402, _))]
pub fn igh_cia402_begin_shutdown(context: *mut igh_cia402_context_t) {
    cia402.begin_shutdown();
}

// Section: Startup and shutdown that wait
//
// These calls run the cycle, with all axes at their last targets, until every axis has reached the
// requested state or cannot reach it: not on a master of another owner, and not in a loop with
// other work. There use the calls of the next section and igh_cia402_get_axis_state().

/// Waits with the cycle running, and reports progress.
fn wait(
    call: Call,
    bus: &mut Entered<Bus>,
    timeout_ms: u32,
    work: impl FnOnce(&mut Blocking<'_>) -> Result<(), Cia402Error>,
) -> Result<(), ecan_result_t> {
    bus.run_to_end(call)?;
    let callback = bus.axes_mut().and_then(|axes| axes.progress);
    let (cia402, port) = bus.need_axes(call)?;
    let waiting = cia402.blocking(port, duration(timeout_ms));
    let mut waiting = waiting.on_progress(|progress| {
        if let Some(callback) = callback {
            callback.report(progress.axis, progress);
        }
    });
    work(&mut waiting).or_code(call)
}

/// Configures every drive in the mode of its axis, CSP by default, and waits: NMT, identity,
/// heartbeats, PDO mapping, limits, Operational, mode with confirmation. Drives that are configured
/// already stay unchanged. An enabled drive is disabled first.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_AXES, where ecan_last_error() names each axis that is not
///          configured, the step at which it stands and what its drive answered; ECAN_ERR_ATTACHED
///          on a master of another owner; ECAN_ERR_ORDER if the bus is not active;
///          ECAN_ERR_AXIS_STATE, ECAN_ERR_MASTER.
#[export(call, bus bus)]
pub fn igh_cia402_configure_csp_all_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.configure())
}

/// Determines the actual position of all axes from fresh TPDOs at rest, and waits. Rejects an axis
/// that is not configured.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes whose position
///          is unknown, and the reason.
#[export(call, bus bus)]
pub fn igh_cia402_request_actual_position_all_timeout(
    context: *mut igh_cia402_context_t,
    timeout_ms: u32,
) {
    wait(call, bus, timeout_ms, |waiting| waiting.read_positions())
}

/// Enables all drives and waits until every axis follows targets. The first target of each is the
/// actual position just read.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that are not
///          enabled, with the state of each drive and the reason. Enabled axes stay enabled.
#[export(call, bus bus)]
pub fn igh_cia402_enable_all_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.enable())
}

/// Runs the three calls above: from drives in any state to axes that follow targets.
///
/// @param timeout_ms  Milliseconds, for each of the three.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As those calls.
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_start_up_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.start_up())
}

/// Waits until the changes of mode and the homings of all axes are done.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes whose last
///          command failed, and the reason.
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_finish_all_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.finish())
}

/// Brings all axes back to their targets, as igh_cia402_recover() with IGH_CIA402_ALL_AXES, and waits.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that do not
///          follow targets, and the reason.
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_recover_all_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.recover())
}

/// Stops all axes, as igh_cia402_stop_all(), and waits until every one has reported that it has stopped, also
/// while the gateway or the path is away.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that did not
///          report that they have stopped, and may still move. Their stop continues in later cycles.
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_stop_all_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.stop())
}

/// Shuts down in order, as igh_cia402_begin_shutdown(), and waits until every axis has reported that it is off.
/// While the gateway or the path is away, the whole time is used: at most half of it, and five seconds, for
/// the ramps.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that could not
///          be disabled, and may still move. The shutdown of the other axes is complete.
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_shutdown_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.shut_down())
}

// Section: Progress of the calls that wait

/// Sets a function to which the waiting calls report the progress of the axes: at their start, and
/// on every change. It runs inside these calls, between two cycles, so it should be quick; a call
/// to the library with this context returns ECAN_ERR_BUSY there.
///
/// @param callback  Gets `user`, the axis, and a text, "axis 0, node 1 (slave 0, channel 0): being
///                  enabled, switched on, for 120 ms" for example, which is valid until it returns;
///                  NULL for none. It must return, as that of ecan_igh_stop_waiting_when().
/// @param user      Is passed to it, in the thread that waits.
///
/// @usage   not rt, the cycle's thread, after init
#[export(_, bus bus)]
pub fn igh_cia402_set_progress_callback(
    context: *mut igh_cia402_context_t,
    callback: Option<
        unsafe extern "C-unwind" fn(user: *mut c_void, axis: usize, text: *const c_char),
    >,
    user: *mut c_void,
) {
    if let Some(axes) = bus.axes_mut() {
        axes.progress = callback.map(|function| ProgressCallback {
            function,
            user,
            setter: "igh_cia402_set_progress_callback()",
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn homing_round_trips() {
        let plain = HomingConfig::new(-3);
        assert_eq!(HomingConfig::from(&plain.into()), plain);
        let full = HomingConfig {
            switch_speed: Some(100),
            zero_speed: Some(10),
            acceleration: Some(1000),
            offset: Some(0),
            ..HomingConfig::new(1)
        };
        assert_eq!(HomingConfig::from(&full.into()), full);
    }
}
