//! Reaction of the drives to the loss of the host

use std::ffi::c_char;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{mirror, pointers};
use ecan_c_export::export;
use ecan_cia402::{HostLoss, HostLossReaction, HostWatch, StopRamp};

use super::context::{igh_cia402_context_t, need_axis};

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
    need_axis(call, cia402, axis)?;
    cia402.host_loss(axis).map(|loss| info(&loss)).ok_or(ecan_result_t::ECAN_ERR_INTERNAL)
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
    need_axis(call, cia402, axis)?;
    let loss = cia402.host_loss(axis).ok_or(ecan_result_t::ECAN_ERR_INTERNAL)?;
    text.put(call, &loss.to_string())
}
