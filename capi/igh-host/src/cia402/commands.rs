//! Commands to axes
//!
//! Each begins something and returns; the cycle goes on with it, and igh_cia402_get_axis_state()
//! tells how far it is. A command to all axes goes to every one, also behind one that refuses; the
//! code is that of the first refusal.

use std::ffi::c_int;

use ecan_canopen::NmtError;
use ecan_cia402::{Cia402, CommandError, HomingConfig};
use ecan_mcan_host::boundary::call;

use super::context::{igh_cia402_context_t, need_axis};
use super::numbers;
use crate::entry::{Entry, enter};
use crate::errors::OrCode as _;
use crate::milliseconds::{duration, milliseconds};

pub(super) fn command(
    entry: Entry<igh_cia402_context_t>,
    command: impl FnOnce(&mut Cia402) -> Result<(), CommandError>,
) -> c_int {
    entry.run(|call, (cia402, _)| command(cia402).or_code(call))
}

/// Sends an NMT command to all nodes of the channels that have axes, with the next targets. After
/// anything but IGH_CANOPEN_NMT_START the axes hold. Configuring a drive sends what it needs by
/// itself.
///
/// @param command  An igh_canopen_nmt_t.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_CANOPEN where so many commands wait that no more can;
///          ECAN_ERR_ARGUMENT, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_send_nmt_all(
    context: *mut igh_cia402_context_t,
    command: c_int,
) -> c_int {
    enter!(igh_cia402_send_nmt_all, context).run(|call, (cia402, _)| {
        cia402.send_nmt_all(numbers::nmt_command(call, command)?).or_code(call)
    })
}

/// Sends an NMT command to the drive of an axis, as igh_cia402_send_nmt_all().
///
/// @param command  An igh_canopen_nmt_t.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_send_nmt_all(); ECAN_ERR_AXIS.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_send_nmt(
    context: *mut igh_cia402_context_t,
    axis: usize,
    command: c_int,
) -> c_int {
    enter!(igh_cia402_send_nmt, context).run(|call, (cia402, _)| {
        let command = numbers::nmt_command(call, command)?;
        need_axis(call, cia402, axis)?;
        let sent = match cia402.node(axis) {
            Some(node) => cia402.network_mut().nmt(node, command),
            None => Err(NmtError::UnknownNode),
        };
        sent.or_code(call)
    })
}

/// Begins to configure every drive that is not configured: what
/// igh_cia402_configure_csp_all_timeout() waits for.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_AXIS_STATE, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_configure_all(context: *mut igh_cia402_context_t) -> c_int {
    command(enter!(igh_cia402_configure_all, context), Cia402::configure_all)
}

/// Begins to configure a drive, also one that is configured: after it restarted, for example. An
/// enabled drive is switched off first.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  As igh_cia402_configure_all(); ECAN_ERR_AXIS.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_configure(
    context: *mut igh_cia402_context_t,
    axis: usize,
) -> c_int {
    command(enter!(igh_cia402_configure, context), |cia402| cia402.configure(axis))
}

/// Begins to establish where all axes are: what may still be under way is waited out, then fresh
/// TPDOs that show them at rest.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_AXIS_STATE for an axis that is not configured, changes its mode or is
///          homing; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_request_actual_position_all(
    context: *mut igh_cia402_context_t,
) -> c_int {
    command(enter!(igh_cia402_request_actual_position_all, context), Cia402::read_position_all)
}

/// Begins to establish where an axis is.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_request_actual_position_all(); ECAN_ERR_AXIS.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_request_actual_position(
    context: *mut igh_cia402_context_t,
    axis: usize,
) -> c_int {
    command(enter!(igh_cia402_request_actual_position, context), |cia402| {
        cia402.read_position(axis)
    })
}

/// Begins to enable all drives, and takes axes up again that hold; those that run go on.
/// igh_cia402_enable_all_timeout() waits for it.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_request_actual_position_all().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_enable_all(context: *mut igh_cia402_context_t) -> c_int {
    command(enter!(igh_cia402_enable_all, context), Cia402::enable_all)
}

/// Begins to enable a drive, or takes an axis up again that holds: its actual position is
/// established, and is its first target. A drive in fault is not enabled: igh_cia402_reset_fault()
/// comes first. What is not done within enable_timeout_ms ends with the drive switched off.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_request_actual_position_all(); ECAN_ERR_AXIS.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_enable(
    context: *mut igh_cia402_context_t,
    axis: usize,
) -> c_int {
    command(enter!(igh_cia402_enable, context), |cia402| cia402.enable(axis))
}

/// Switches all drives off, as igh_cia402_disable().
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_disable_all(context: *mut igh_cia402_context_t) -> c_int {
    enter!(igh_cia402_disable_all, context).run(|_, (cia402, _)| {
        cia402.disable_all();
        Ok(())
    })
}

/// Ends targets at once and switches a drive off; how it stops is its own affair (0x605C).
/// igh_cia402_halt() first brings it to rest.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_disable(
    context: *mut igh_cia402_context_t,
    axis: usize,
) -> c_int {
    command(enter!(igh_cia402_disable, context), |cia402| cia402.disable(axis))
}

/// Commands a quick stop to all drives, as igh_cia402_quick_stop().
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_quick_stop_all(context: *mut igh_cia402_context_t) -> c_int {
    enter!(igh_cia402_quick_stop_all, context).run(|_, (cia402, _)| {
        cia402.quick_stop_all();
        Ok(())
    })
}

/// Ends targets at once and commands a quick stop; the drive stops as its 0x605A says.
/// igh_cia402_enable() takes the axis up again.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_quick_stop(
    context: *mut igh_cia402_context_t,
    axis: usize,
) -> c_int {
    command(enter!(igh_cia402_quick_stop, context), |cia402| cia402.quick_stop(axis))
}

/// Resets the fault of a drive. It is not enabled by that.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_request_actual_position_all(); ECAN_ERR_AXIS.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_reset_fault(
    context: *mut igh_cia402_context_t,
    axis: usize,
) -> c_int {
    command(enter!(igh_cia402_reset_fault, context), |cia402| cia402.reset_fault(axis))
}

/// Brings a running axis to rest and keeps it enabled: in CSP by its ramp, in CSV and CST by taking
/// the target back to 0 in steps of the limit, in PP, PV and PT by the halt bit. Targets are
/// ignored until igh_cia402_resume().
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_halt(context: *mut igh_cia402_context_t, axis: usize) -> c_int {
    command(enter!(igh_cia402_halt, context), |cia402| cia402.halt(axis))
}

/// Lets a halted axis follow targets again.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_resume(
    context: *mut igh_cia402_context_t,
    axis: usize,
) -> c_int {
    command(enter!(igh_cia402_resume, context), |cia402| cia402.resume(axis))
}

/// Begins to change the mode of a drive, with its mode display as confirmation. A running axis is
/// brought to rest and disabled before, and enabled again after.
///
/// @param mode  An igh_cia402_mode_t whose target is in the process data that the axis' own mode
///              mapped; not homing, which igh_cia402_home() does.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_request_actual_position_all(), ECAN_ERR_AXIS_STATE also for a mode that
///          is not mapped; ECAN_ERR_AXIS, ECAN_ERR_ARGUMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_change_mode(
    context: *mut igh_cia402_context_t,
    axis: usize,
    mode: c_int,
) -> c_int {
    enter!(igh_cia402_change_mode, context)
        .run(|call, (cia402, _)| cia402.change_mode(axis, numbers::mode(call, mode)?).or_code(call))
}

/// How an axis finds its home position. igh_cia402_homing_init() fills it. Objects that a drive
/// does not have are skipped, apart from the method.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct igh_cia402_homing_t {
    /// Speed on the way to the switch, 0x6099:01, in the drive's units; 0 leaves it alone.
    pub switch_speed: u32,
    /// Speed on the way to the zero, 0x6099:02; 0 leaves it alone.
    pub zero_speed: u32,
    /// Acceleration, 0x609A; 0 leaves it alone.
    pub acceleration: u32,
    /// What the home position is called, 0x607C, in steps, where has_offset is 1.
    pub offset: i32,
    /// How long it may take, in milliseconds. Default 60000.
    pub timeout_ms: u32,
    /// Homing method, 0x6098: 35 and 37 take the present position as home, 1 to 34 look for
    /// switches and index pulses, negative ones are the manufacturer's.
    pub method: i8,
    /// 1: the offset is written. Default 0.
    pub has_offset: u8,
    /// Not used.
    pub reserved: [u8; 2],
}

impl From<HomingConfig> for igh_cia402_homing_t {
    fn from(from: HomingConfig) -> Self {
        Self {
            switch_speed: from.switch_speed.unwrap_or(0),
            zero_speed: from.zero_speed.unwrap_or(0),
            acceleration: from.acceleration.unwrap_or(0),
            offset: from.offset.unwrap_or(0),
            timeout_ms: milliseconds(from.timeout),
            method: from.method,
            has_offset: from.offset.is_some().into(),
            reserved: [0; 2],
        }
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

/// Fills a homing: a method with the drive's own speeds, and a minute for it.
///
/// @param homing  Is overwritten, whatever it holds.
/// @param method  Homing method, 0x6098.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK or ECAN_ERR_NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_homing_init(
    homing: *mut igh_cia402_homing_t,
    method: i8,
) -> c_int {
    call("igh_cia402_homing_init", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { call.out("homing", homing)? }.set(HomingConfig::new(method).into());
        Ok(())
    })
}

/// Begins homing: to rest, power off, parameters and mode, power on, homing, power off, the mode
/// before, and power on again where it was. The axis is taken up from what its position counter
/// says then.
///
/// @param homing  Is copied.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_request_actual_position_all(); ECAN_ERR_AXIS.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_home(
    context: *mut igh_cia402_context_t,
    axis: usize,
    homing: *const igh_cia402_homing_t,
) -> c_int {
    enter!(igh_cia402_home, context).run(|call, (cia402, _)| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let homing = unsafe { call.read("homing", homing)? };
        cia402.home(axis, homing.into()).or_code(call)
    })
}

/// Begins an orderly end: every axis comes to rest by its ramp, is disabled and released, so that
/// no drive reports a fault when the host leaves. Go on with the cycle until
/// igh_cia402_shutdown_is_done(). A stage that an axis cannot finish ends after five seconds.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_begin_shutdown(context: *mut igh_cia402_context_t) -> c_int {
    enter!(igh_cia402_begin_shutdown, context).run(|_, (cia402, _)| {
        cia402.begin_shutdown();
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_homing_comes_back() {
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
