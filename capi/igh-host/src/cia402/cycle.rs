//! The cycle
//!
//! ```c
//! igh_mcan_port_wait_next_cycle(&mcan);
//! igh_mcan_port_cycle_begin(&mcan);
//! igh_cia402_process_rx(&motors);
//! igh_cia402_set_target(&motors, 0, target);
//! igh_cia402_send_targets_all(&motors);
//! igh_mcan_port_cycle_end(&mcan);
//! ```
//!
//! An axis gets a target only if nothing prevents it: an incomplete working counter, a repeated
//! image, a step beyond the limit, a drive that is not enabled. If the reason is not temporary, the
//! axis holds; igh_cia402_enable() activates it again.

use std::ffi::c_int;

use ecan_c_boundary::frames::igh_mcan_rx_frame_t;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_cia402::{Cia402, SendSummary};
use ecan_mcan_port::Cycle;

use super::context::igh_cia402_context_t;
use crate::bus::{self, Bus};
use crate::errors::OrCode as _;
use crate::handle::Entered;
use crate::mcan_port::cycle::owned_rx_frame;

/// Offset of igh_cia402_set_scheduled_tx() for sending at once.
pub const IGH_CIA402_AT_ONCE: u32 = 0xFFFF_FFFF;

mirror! {
    /// Targets and SYNC messages of one cycle.
    #[derive(Default, PartialEq, Eq)]
    pub struct igh_cia402_send_summary_t from rust: SendSummary {
        /// Axes that got a target of the application, or their step.
        targets: u32 = rust.targets as u32,
        /// Axes that got their actual position as target, while they are enabled or activated.
        positions: u32 = rust.positions as u32,
        /// Active axes that got nothing in this cycle: their motion must not continue.
        waiting: u32 = rust.waiting as u32,
        /// Axes whose target was rejected.
        rejected: u32 = rust.rejected as u32,
        /// Axes that are not active, hold, or have no target due in this cycle.
        closed: u32 = rust.closed as u32,
        /// SYNC messages.
        syncs: u32 = rust.syncs as u32,
        /// 1 if every axis got a target of the application.
        all_moved: u8 = rust.all_moved().into(),
        /// Zero; for fields of later versions.
        reserved: [u8; 23] = [0; 23],
    }
}

/// Processes TPDOs, SDO responses, heartbeats and emergencies, and runs the next step of every
/// axis. First in the open cycle, in place of igh_mcan_port_receive(). Frames that do not belong to
/// the axes are dropped; igh_cia402_process_rx_ex() returns them. A further call in the same cycle does nothing.
///
/// @usage   rt, the cycle's thread, in an open cycle
/// @return  ECAN_OK; ECAN_ERR_ORDER if no cycle is open.
#[export(call, layer(cia402, port))]
pub fn igh_cia402_process_rx(context: *mut igh_cia402_context_t) {
    cia402.process_rx(&mut bus::open_cycle(call, port)?);
}

/// As igh_cia402_process_rx(); returns everything that belongs neither to the axes nor to their
/// network: frames of other nodes, other PDOs, transmit results (kind).
///
/// @param rx        Gets the items.
/// @param capacity  Items that fit.
/// @param rx_count  Gets the number of items.
///
/// @usage   rt, the cycle's thread, in an open cycle
/// @return  As igh_cia402_process_rx(); ECAN_ERR_BUFFER if not all items fit: the others are lost,
///          everything else is done.
#[export(call, layer(cia402, port))]
pub fn igh_cia402_process_rx_ex(
    context: *mut igh_cia402_context_t,
    rx: *mut igh_mcan_rx_frame_t,
    capacity: usize,
    rx_count: *mut usize,
) {
    pointers!(call, room(rx, capacity), out(rx_count));
    rx_count.set(0);
    let mut lost = 0_usize;
    let mut cycle = bus::open_cycle(call, port)?;
    cia402.process_rx_with(&mut cycle, |item| {
        lost += usize::from(!rx.push(owned_rx_frame(&item)));
    });
    rx_count.set(rx.count());
    if lost > 0 {
        let text = format_args!("{lost} more frames were received than the {capacity} that fit");
        return Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text));
    }
}

fn send(
    call: Call,
    bus: &mut Entered<Bus>,
    send: impl FnOnce(&mut Cia402, &mut Cycle<'_>) -> SendSummary,
) -> Result<(), ecan_result_t> {
    let (cia402, port) = bus.need_axes(call)?;
    let summary = send(cia402, &mut bus::open_cycle(call, port)?);
    if let Some(axes) = bus.axes_mut() {
        axes.summary = summary;
    }
    Ok(())
}

/// Sends targets and commands of all axes, then SYNC, then pending NMT, SDO and heartbeat frames.
/// Last in the open cycle. A further call in the same cycle, of this function or of
/// igh_cia402_send_target_step(), sends nothing, and its summary counts every axis as closed: targets and
/// commands since the first call are those of the next cycle.
///
/// @usage   rt, the cycle's thread, in an open cycle after igh_cia402_process_rx
/// @return  ECAN_OK; ECAN_ERR_ORDER if no cycle is open. igh_cia402_get_send_summary() reports the
///          targets.
#[export(call, bus bus)]
pub fn igh_cia402_send_targets_all(context: *mut igh_cia402_context_t) {
    send(call, bus, Cia402::send_targets_all)
}

/// As igh_cia402_send_targets_all(); moves every CSP axis by its own target step, which it reaches
/// by its ramp. An axis does not move in a cycle in which its target is not sent.
///
/// @usage   rt, the cycle's thread, in an open cycle after igh_cia402_process_rx
/// @return  As igh_cia402_send_targets_all().
#[export(call, bus bus)]
pub fn igh_cia402_send_target_step(context: *mut igh_cia402_context_t) {
    send(call, bus, Cia402::send_target_step)
}

/// Gets the summary of the last igh_cia402_send_targets_all() or igh_cia402_send_target_step().
///
/// @usage   rt, the cycle's thread, after init
#[export(call, bus bus)]
pub fn igh_cia402_get_send_summary(
    context: *mut igh_cia402_context_t,
    summary: *mut igh_cia402_send_summary_t,
) {
    pointers!(call, out(summary));
    summary.set(bus.axes_mut().map(|axes| axes.summary).unwrap_or_default().into());
}

/// Sends targets only in every n-th cycle (--motion-div); more if SYNC is sent less often, since a
/// target takes effect with a SYNC. Step limit, ramp and target step apply per target. Only while no
/// axis is configured: the configuration writes the target period to the drives (0x60C2).
///
/// @param motion_div  Fewest cycles from target to target; 0 counts as 1.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_AXIS_STATE if an axis is configured or being configured;
///          ECAN_ERR_CONFIG for a period that 0x60C2 cannot have (CSP).
#[export(call, layer(cia402, _))]
pub fn igh_cia402_set_motion_div(context: *mut igh_cia402_context_t, motion_div: u32) {
    cia402.set_motion_div(motion_div).or_code(call)
}

/// Sends targets and SYNC at phases of the Sync0 period instead of at once (manual 8.4, 13.8),
/// independently. Needs distributed clocks with Sync0. Only while no axis is active.
///
/// A gateway drops a scheduled frame that arrives after its phase, and the drive keeps the previous
/// target: leave a margin.
///
/// @param enable          0 sends both at once, for any offsets; else they are scheduled.
/// @param rpdo_offset_ns  Nanoseconds after Sync0 at which targets are sent, or IGH_CIA402_AT_ONCE.
/// @param sync_offset_ns  The same for SYNC; not before the targets.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_SCHEDULE without Sync0, beyond its period, or on a gateway that
///          cannot; ECAN_ERR_AXIS_STATE while an axis is active; ECAN_ERR_ARGUMENT for SYNC ahead
///          of the targets. After an error everything is as it was.
#[export(call, layer(cia402, port))]
pub fn igh_cia402_set_scheduled_tx(
    context: *mut igh_cia402_context_t,
    enable: c_int,
    rpdo_offset_ns: u32,
    sync_offset_ns: u32,
) {
    let offset = |ns: u32| (enable != 0 && ns != IGH_CIA402_AT_ONCE).then_some(ns);
    cia402.set_scheduled_tx(port, offset(rpdo_offset_ns), offset(sync_offset_ns)).or_code(call)
}
