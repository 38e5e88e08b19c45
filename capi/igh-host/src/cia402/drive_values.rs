//! Values that drives report: limits, units, reaction to the loss of the host.

use std::ffi::c_char;

use ecan_c_boundary::{mirror, pointers};
use ecan_c_export::export;
use ecan_cia402::{HostLoss, HostLossReaction, HostWatch, ScaleFinding, StopRamp};

use super::context::{igh_cia402_context_t, need_axis};

// Section: Limits and units of drives
//
// Read from a drive at the end of its configuration, if use_drive_limits or scale_source of
// igh_cia402_axis_t ask for it.

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
    let axis = need_axis(call, cia402, axis)?;
    let read = axis.drive().limits;
    let drive = read.unwrap_or_default();
    let in_force = axis.guard().limits();
    let bounds = in_force.bounds;
    Ok(igh_cia402_drive_limits_t {
        position_min: drive.position.map_or(0, |(min, _)| min),
        position_max: drive.position.map_or(0, |(_, max)| max),
        max_motor_speed: drive.max_motor_speed.unwrap_or(0),
        step_limit: in_force.step,
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
    let values = need_axis(call, cia402, axis)?.drive();
    let read = values.units;
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
        finding: igh_cia402_scale_finding_t::from(values.scale_finding) as u8,
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
    let finding = need_axis(call, cia402, axis)?.drive().scale_finding;
    let finding = finding.map(|finding| finding.to_string());
    text.put(call, &finding.unwrap_or_default())
}

// Section: Reaction of the drives to the loss of the host

mirror! {
    /// Detection of the loss of the host by a drive.
    pub enum igh_cia402_host_watch_t from HostWatch {
        /// None: the stop options of the drive were not read yet.
        IGH_CIA402_HOST_WATCH_UNREAD = 0 => HostWatch::Unread,
        /// None: the host sends no heartbeat.
        IGH_CIA402_HOST_WATCH_NO_HEARTBEAT = 1 => HostWatch::NoHeartbeat,
        /// None: 0x1016 has no entry for the node-ID of the host.
        IGH_CIA402_HOST_WATCH_NO_ENTRY = 2 => HostWatch::NoEntry,
        /// By 0x1016, after watch_ms without a heartbeat.
        IGH_CIA402_HOST_WATCH_ACTIVE = 3 => HostWatch::Active(_),
        /// By life guarding, after watch_ms without a request of the host.
        IGH_CIA402_HOST_WATCH_GUARDED = 4 => HostWatch::Guarded(_),
        /// Another one.
        IGH_CIA402_HOST_WATCH_OTHER = 255 => _,
    }
}

mirror! {
    /// Reaction of an enabled drive to the loss of the host.
    pub enum igh_cia402_host_loss_reaction_t from HostLossReaction {
        /// Unknown: not read yet, or an object is missing or manufacturer-specific.
        IGH_CIA402_HOST_LOSS_REACTION_UNKNOWN = 0 => HostLossReaction::Unknown,
        /// Quick stop, with `ramp`.
        IGH_CIA402_HOST_LOSS_REACTION_QUICK_STOP = 1 => HostLossReaction::QuickStop(_),
        /// Stops with `ramp`, then Fault.
        IGH_CIA402_HOST_LOSS_REACTION_FAULT = 2 => HostLossReaction::Fault(_),
        /// Switches power off; the motor coasts.
        IGH_CIA402_HOST_LOSS_REACTION_COASTS = 3 => HostLossReaction::Coasts,
        /// Keeps its last target position.
        IGH_CIA402_HOST_LOSS_REACTION_HOLDS_POSITION = 4 => HostLossReaction::HoldsPosition,
        /// Continues with the last velocity or torque; in PP it moves to the end of its set-points.
        IGH_CIA402_HOST_LOSS_REACTION_RUNS_ON = 5 => HostLossReaction::RunsOn,
        /// Another one.
        IGH_CIA402_HOST_LOSS_REACTION_OTHER = 255 => _,
    }
}

mirror! {
    /// Deceleration of a drive.
    pub enum igh_cia402_stop_ramp_t from Option<StopRamp> {
        /// Nothing: it does not stop by a ramp.
        IGH_CIA402_STOP_RAMP_NONE = 0 => None,
        /// Profile deceleration, 0x6084.
        IGH_CIA402_STOP_RAMP_PROFILE = 1 => Some(StopRamp::Profile),
        /// Quick stop deceleration, 0x6085.
        IGH_CIA402_STOP_RAMP_QUICK_STOP = 2 => Some(StopRamp::QuickStop),
        /// Current limit of the drive.
        IGH_CIA402_STOP_RAMP_CURRENT_LIMIT = 3 => Some(StopRamp::CurrentLimit),
        /// Voltage limit of the drive.
        IGH_CIA402_STOP_RAMP_VOLTAGE_LIMIT = 4 => Some(StopRamp::VoltageLimit),
        /// Another one.
        IGH_CIA402_STOP_RAMP_OTHER = 255 => Some(_),
    }
}

/// Reaction of a drive to the loss of the host, by the options that it reported at the end of its
/// configuration, in the present mode.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_cia402_host_loss_info_t {
    /// Time without a heartbeat or a guarding request of the host after which the drive reacts, in
    /// milliseconds, if `watch` is IGH_CIA402_HOST_WATCH_ACTIVE or IGH_CIA402_HOST_WATCH_GUARDED; else 0.
    pub watch_ms: u32,
    /// Deceleration in units of the drive, if has_deceleration is 1.
    pub deceleration: u32,
    /// An igh_cia402_host_watch_t.
    pub watch: u8,
    /// An igh_cia402_host_loss_reaction_t.
    pub reaction: u8,
    /// An igh_cia402_stop_ramp_t.
    pub ramp: u8,
    /// 1 if 0x6084 or 0x6085 determines the deceleration, and the drive has the object.
    pub has_deceleration: u8,
    /// 1 if the drive brings the motor to rest and controls it until then; 0 if it runs on or coasts,
    /// and if the reaction is unknown.
    pub is_controlled_stop: u8,
    /// Zero; for fields of later versions.
    pub reserved: [u8; 19],
}

fn info(loss: &HostLoss) -> igh_cia402_host_loss_info_t {
    let watch_ms = match loss.watch {
        HostWatch::Active(time) | HostWatch::Guarded(time) => {
            u32::try_from(time.as_millis()).unwrap_or(u32::MAX)
        }
        _ => 0,
    };
    let ramp = match loss.reaction {
        HostLossReaction::QuickStop(ramp) | HostLossReaction::Fault(ramp) => Some(ramp),
        _ => None,
    };
    igh_cia402_host_loss_info_t {
        watch_ms,
        deceleration: loss.deceleration.unwrap_or(0),
        watch: igh_cia402_host_watch_t::from(loss.watch) as u8,
        reaction: igh_cia402_host_loss_reaction_t::from(loss.reaction) as u8,
        ramp: igh_cia402_stop_ramp_t::from(ramp) as u8,
        has_deceleration: loss.deceleration.is_some().into(),
        is_controlled_stop: loss.reaction.is_controlled_stop().into(),
        reserved: [0; 19],
    }
}

/// Gets the reaction of a drive to the loss of the host: its end, its crash, or the loss of the
/// link.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _), into host_loss)]
pub fn igh_cia402_get_host_loss(
    context: *mut igh_cia402_context_t,
    axis: usize,
    host_loss: *mut igh_cia402_host_loss_info_t,
) {
    Ok(info(&need_axis(call, cia402, axis)?.host_loss()))
}

/// Gets the reaction of a drive to the loss of the host as text: "axis 2, node 5 (slave 0, channel
/// 1), CSV: runs on if the host is lost (the host sends no heartbeat)" for example.
///
/// @param text  See the rules for texts in igh_ecan_common.h.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_BUFFER.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_get_host_loss_text(
    context: *mut igh_cia402_context_t,
    axis: usize,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(text, size, needed));
    text.put(call, &need_axis(call, cia402, axis)?.host_loss().to_string())
}
