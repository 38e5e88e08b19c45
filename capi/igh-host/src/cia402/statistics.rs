//! Counters and bus load
//!
//! Counters only grow.

use std::ffi::c_int;

use ecan_cia402::{AxisStatistics, BusLoad, LoadWarning};
use ecan_mcan_host::common::result::ecan_result_t;
use ecan_mcan_host::mirror;

use super::context::{igh_cia402_context_t, need_axis};
use super::state_terms::igh_cia402_hold_t;
use crate::entry::enter;

mirror! {
    /// Counters of an axis.
    pub struct igh_cia402_axis_statistics_t from rust: AxisStatistics {
        /// Targets handed to the gateway, the first ones included.
        targets_sent: u64,
        /// Times that the axis was taken up while enabled.
        take_ups: u64 = rust.activations,
        /// Targets of the application that were refused, for any reason.
        targets_refused: u64 = rust.targets_rejected,
        /// Those refused because of the step limit.
        refused_step: u64 = rust.rejected_step,
        /// Those refused because of the following window.
        refused_window: u64 = rust.rejected_window,
        /// Cycles in which a running axis got no target: a missed working counter, a repeated
        /// image, no room.
        waits: u64,
        /// Times that the axis held.
        holds: u64,
        /// TPDOs received.
        tpdos: u64,
        /// TPDOs too short for the mapping.
        malformed_tpdos: u64,
        /// TPDOs that never came, by the number of SYNCs sent.
        lost_tpdos: u64,
        /// Cycles with an actual position that is not worth the name: in an incomplete image,
        /// behind a backlog.
        unusable_positions: u64,
        /// Largest distance between target and actual position while targets went out, in steps.
        max_following_error: u64,
        /// Targets that the gateway reported as not sent.
        targets_lost: u64,
        /// Faults of the drive.
        faults: u64,
        /// Emergency messages.
        emergencies: u32,
        /// Most cycles in a row without a usable TPDO while the axis was enabled.
        longest_gap: u16,
        /// An igh_cia402_hold_t: why the axis held last.
        last_hold: u8 = igh_cia402_hold_t::from(rust.last_hold) as u8,
        /// Not used.
        reserved: u8 = 0,
    }
}

mirror! {
    /// What does not fit any more on a channel.
    pub enum igh_cia402_load_warning_t from Option<LoadWarning> {
        /// There is room for everything.
        IGH_CIA402_LOAD_OK = 0 => None,
        /// Less than a tenth is left for SDO, heartbeats and emergencies.
        IGH_CIA402_LOAD_NO_RESERVE = 1 => Some(LoadWarning::NoReserve),
        /// With unlucky data the bus is too slow for a cycle now and then.
        IGH_CIA402_LOAD_TIGHT = 2 => Some(LoadWarning::Tight),
        /// More frames in a cycle than the gateway serves in one direction.
        IGH_CIA402_LOAD_BUDGET = 3 => Some(LoadWarning::Budget),
        /// The bus is too slow for the cycle: targets pile up, and the axes will hold.
        IGH_CIA402_LOAD_TOO_MUCH = 4 => Some(LoadWarning::TooMuch),
    }
}

mirror! {
    /// Load of one channel by the process data of its axes and SYNC. SDO, heartbeats and NMT need
    /// what is left.
    pub struct igh_cia402_bus_load_t from rust: BusLoad {
        /// Share of the bus without a stuff bit; 1.0 is all of it.
        least: f64,
        /// Share of the bus with as many stuff bits as are possible.
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
    }
}

/// Counters of an axis.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_get_axis_statistics(
    context: *mut igh_cia402_context_t,
    axis: usize,
    statistics: *mut igh_cia402_axis_statistics_t,
) -> c_int {
    enter!(igh_cia402_get_axis_statistics, context -> statistics).fill(|call, (cia402, _)| {
        need_axis(call, cia402, axis)?;
        Ok(cia402.statistics(axis).into())
    })
}

/// How much of each CAN bus the process data take, by the bit rates of the Port: each channel that
/// has axes.
///
/// @param loads     Room for channels.
/// @param capacity  Channels that fit.
/// @param count     Gets the number of channels that have axes, also where they do not all fit.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_BUFFER where not all fit; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
///          ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_get_bus_load(
    context: *mut igh_cia402_context_t,
    loads: *mut igh_cia402_bus_load_t,
    capacity: usize,
    count: *mut usize,
) -> c_int {
    enter!(igh_cia402_get_bus_load, context).run(|call, (cia402, port)| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut room, out) =
            unsafe { (call.room("loads", loads, capacity)?, call.out("count", count)?) };
        let loads = cia402.bus_load(port);
        out.set(loads.len());
        if loads.iter().all(|load| room.push((*load).into())) {
            return Ok(());
        }
        let text = format_args!("{} channels have axes, {capacity} fit", loads.len());
        Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text))
    })
}
