//! Limits and units of drives
//!
//! Read from a drive at the end of its configuration, if use_drive_limits or scale_source of
//! igh_cia402_axis_t ask for it.

use std::ffi::c_char;

use ecan_c_boundary::{mirror, pointers};
use ecan_c_export::export;
use ecan_cia402::ScaleFinding;

use super::context::{igh_cia402_context_t, need_axis};

/// Limits of a drive, and those in force for the targets of its axis.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_cia402_drive_limits_t {
    /// Software position limit 0x607D:01 of the drive, in steps, if has_position is 1.
    pub position_min: i32,
    /// Software position limit 0x607D:02. Both without effect if the first is not below the second.
    pub position_max: i32,
    /// Largest speed of the motor 0x6080, in revolutions per minute, if has_max_motor_speed is 1.
    pub max_motor_speed: u32,
    /// In force: largest distance between consecutive targets; 0xFFFFFFFF for none.
    pub step_limit: u32,
    /// In force: smallest target, if has_bounds is 1.
    pub bound_min: i32,
    /// In force: largest target, if has_bounds is 1.
    pub bound_max: i32,
    /// Largest torque 0x6072, in thousandths of the rated torque, if has_max_torque is 1.
    pub max_torque: u16,
    /// 1 if the limits of the drive were read.
    pub is_read: u8,
    /// 1 if the drive has 0x607D.
    pub has_position: u8,
    /// 1 if the drive has 0x6080.
    pub has_max_motor_speed: u8,
    /// 1 if the drive has 0x6072.
    pub has_max_torque: u8,
    /// 1 if bounds are in force.
    pub has_bounds: u8,
    /// Zero; for fields of later versions.
    pub reserved: [u8; 17],
}

mirror! {
    /// Difference between the scale of an axis and the units of its drive.
    pub enum igh_cia402_scale_finding_t from Option<ScaleFinding> {
        /// None, or not compared.
        IGH_CIA402_SCALE_FINDING_NONE = 0 => None,
        /// The drive has no units by which the scale can be compared.
        IGH_CIA402_SCALE_FINDING_UNAVAILABLE = 1 => Some(ScaleFinding::Unavailable),
        /// The steps per turn differ.
        IGH_CIA402_SCALE_FINDING_STEPS_PER_TURN = 2 => Some(ScaleFinding::StepsPerTurn { .. }),
        /// The velocity units differ.
        IGH_CIA402_SCALE_FINDING_VELOCITY_UNITS = 3 => Some(ScaleFinding::VelocityUnits { .. }),
        /// Another one.
        IGH_CIA402_SCALE_FINDING_OTHER = 255 => Some(_),
    }
}

/// Units of a drive. Values of an object that the drive does not have are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_cia402_drive_units_t {
    /// Steps per turn of the shaft by 0x608F, 0x6091 and 0x6092; 0 if they are unknown.
    pub steps_per_turn: f64,
    /// Units of velocity for one turn of the shaft per second, by 0x60A9; 0 if they are unknown.
    pub velocity_units: f64,
    /// Encoder resolution 0x608F: increments ...
    pub encoder_increments: u32,
    /// ... per motor revolutions.
    pub encoder_revolutions: u32,
    /// Gear ratio 0x6091: motor revolutions ...
    pub gear_motor: u32,
    /// ... per revolutions of the shaft.
    pub gear_shaft: u32,
    /// Feed constant 0x6092: position units ...
    pub feed_units: u32,
    /// ... per revolutions of the shaft.
    pub feed_revolutions: u32,
    /// SI unit of positions 0x60A8.
    pub position_unit: u32,
    /// SI unit of velocities 0x60A9.
    pub velocity_unit: u32,
    /// 1 if the units were read.
    pub is_read: u8,
    /// An igh_cia402_scale_finding_t; igh_cia402_get_scale_text() describes it.
    pub finding: u8,
    /// Zero; for fields of later versions.
    pub reserved: [u8; 30],
}

/// Gets the limits of a drive, and those in force for the targets of its axis.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _), into limits)]
pub fn igh_cia402_get_drive_limits(
    context: *mut igh_cia402_context_t,
    axis: usize,
    limits: *mut igh_cia402_drive_limits_t,
) {
    need_axis(call, cia402, axis)?;
    let read = cia402.drive_limits(axis);
    let drive = read.unwrap_or_default();
    let in_force = cia402.guard(axis).map(|guard| *guard.limits());
    let bounds = in_force.and_then(|limits| limits.bounds);
    Ok(igh_cia402_drive_limits_t {
        position_min: drive.position.map_or(0, |(min, _)| min),
        position_max: drive.position.map_or(0, |(_, max)| max),
        max_motor_speed: drive.max_motor_speed.unwrap_or(0),
        step_limit: in_force.map_or(0, |limits| limits.step),
        bound_min: bounds.map_or(0, |(min, _)| min),
        bound_max: bounds.map_or(0, |(_, max)| max),
        max_torque: drive.max_torque.unwrap_or(0),
        is_read: read.is_some().into(),
        has_position: drive.position.is_some().into(),
        has_max_motor_speed: drive.max_motor_speed.is_some().into(),
        has_max_torque: drive.max_torque.is_some().into(),
        has_bounds: bounds.is_some().into(),
        reserved: [0; 17],
    })
}

/// Gets the units of a drive.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _), into units)]
pub fn igh_cia402_get_drive_units(
    context: *mut igh_cia402_context_t,
    axis: usize,
    units: *mut igh_cia402_drive_units_t,
) {
    need_axis(call, cia402, axis)?;
    let read = cia402.drive_units(axis);
    let drive = read.unwrap_or_default();
    let (encoder, gear, feed) = (
        drive.encoder.unwrap_or_default(),
        drive.gear.unwrap_or_default(),
        drive.feed.unwrap_or_default(),
    );
    Ok(igh_cia402_drive_units_t {
        steps_per_turn: drive.steps_per_turn().unwrap_or(0.0),
        velocity_units: drive.velocity_units().unwrap_or(0.0),
        encoder_increments: encoder.0,
        encoder_revolutions: encoder.1,
        gear_motor: gear.0,
        gear_shaft: gear.1,
        feed_units: feed.0,
        feed_revolutions: feed.1,
        position_unit: drive.position.map_or(0, |unit| unit.0),
        velocity_unit: drive.velocity.map_or(0, |unit| unit.0),
        is_read: read.is_some().into(),
        finding: igh_cia402_scale_finding_t::from(cia402.scale_finding(axis)) as u8,
        reserved: [0; 30],
    })
}

/// Gets the difference between the scale of an axis and the units of its drive as text: "steps_per_turn
/// is 360, the drive has 65536" for example. Empty without a difference.
///
/// @param text  See the rules for texts in igh_ecan_common.h.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_BUFFER.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_get_scale_text(
    context: *mut igh_cia402_context_t,
    axis: usize,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(text, size, needed));
    need_axis(call, cia402, axis)?;
    let finding = cia402.scale_finding(axis).map(|finding| finding.to_string());
    text.put(call, &finding.unwrap_or_default())
}
