//! Targets
//!
//! A target stays until the next one. A hold drops it; after activation the axis stays at its
//! position until it gets a new target.

use super::context::igh_cia402_context_t;
use crate::errors::OrCode as _;
use ecan_c_export::export;

/// Sets the target of an axis. igh_cia402_get_axis_state() reports the decision on it after the
/// targets were sent.
///
/// @param target  Raw units of the mode: steps, velocity or torque.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _))]
pub fn igh_cia402_set_target(context: *mut igh_cia402_context_t, axis: usize, target: i32) {
    cia402.set_target(axis, target).or_code(call)
}

/// As igh_cia402_set_target(), with an angle by the axis' steps_per_turn and origin.
///
/// @param radians  Radians of the axis.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_set_target(); ECAN_ERR_ARGUMENT for an angle without a position.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_set_target_radians(
    context: *mut igh_cia402_context_t,
    axis: usize,
    radians: f64,
) {
    cia402.set_target_radians(axis, radians).or_code(call)
}

/// Sets the step of igh_cia402_send_target_step(); the axis reaches it by its ramp.
///
/// @param step  Steps per target. A step beyond the step limit is rejected when the ramp reaches it.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_set_target().
#[export(call, layer(cia402, _))]
pub fn igh_cia402_set_target_step(context: *mut igh_cia402_context_t, axis: usize, step: i32) {
    cia402.set_target_step(axis, step).or_code(call)
}
