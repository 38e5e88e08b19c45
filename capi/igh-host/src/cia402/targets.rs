//! Targets
//!
//! A target stays until the next one. A hold drops it; after activation the axis stays at its
//! position until it gets a new target.

use std::ffi::c_int;

use super::commands::command;
use super::context::igh_cia402_context_t;
use crate::entry::enter;

/// Sets the target of an axis. igh_cia402_get_axis_state() reports the decision on it after the
/// targets were sent.
///
/// @param target  Raw units of the mode: steps, velocity or torque.
///
/// @usage   rt, the cycle's thread, after init
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_set_target(
    context: *mut igh_cia402_context_t,
    axis: usize,
    target: i32,
) -> c_int {
    command(enter!(igh_cia402_set_target, context), |cia402| cia402.set_target(axis, target))
}

/// As igh_cia402_set_target(), with an angle by the axis' steps_per_turn and origin.
///
/// @param degrees  Degrees of the axis.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_set_target(); ECAN_ERR_ARGUMENT for an angle without a position.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_set_target_degrees(
    context: *mut igh_cia402_context_t,
    axis: usize,
    degrees: f64,
) -> c_int {
    command(enter!(igh_cia402_set_target_degrees, context), |cia402| {
        cia402.set_target_degrees(axis, degrees)
    })
}

/// As igh_cia402_set_target(), with an angle by the axis' steps_per_turn and origin.
///
/// @param radians  Radians of the axis.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_set_target(); ECAN_ERR_ARGUMENT for an angle without a position.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_set_target_radians(
    context: *mut igh_cia402_context_t,
    axis: usize,
    radians: f64,
) -> c_int {
    command(enter!(igh_cia402_set_target_radians, context), |cia402| {
        cia402.set_target_radians(axis, radians)
    })
}

/// Sets the step of igh_cia402_send_target_step(); the axis reaches it by its ramp.
///
/// @param step  Steps per cycle. A step beyond the step limit is rejected when the ramp reaches it.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_set_target().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_set_target_step(
    context: *mut igh_cia402_context_t,
    axis: usize,
    step: i32,
) -> c_int {
    command(enter!(igh_cia402_set_target_step, context), |cia402| {
        cia402.set_target_step(axis, step)
    })
}
