//! Counters and bus load
//!
//! Counters only grow.

use std::ffi::c_int;

use ecan_cia402::{AxisStatistics, BusLoad, LoadWarning};
use ecan_mcan_host::boundary::call;
use ecan_mcan_host::common::result::ecan_result_t;

use super::context::{igh_cia402_context_t, need_axis, on_axes};
use super::state_terms::{hold, igh_cia402_hold_t};

/// Counters of an axis.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_cia402_axis_statistics_t {
    /// Targets handed to the gateway, the first ones included.
    pub targets_sent: u64,
    /// Times that the axis was taken up while enabled.
    pub take_ups: u64,
    /// Targets of the application that were refused, for any reason.
    pub targets_refused: u64,
    /// Those refused because of the step limit.
    pub refused_step: u64,
    /// Those refused because of the following window.
    pub refused_window: u64,
    /// Cycles in which a running axis got no target: a missed working counter, a repeated image, no
    /// room.
    pub waits: u64,
    /// Times that the axis held.
    pub holds: u64,
    /// TPDOs received.
    pub tpdos: u64,
    /// TPDOs too short for the mapping.
    pub malformed_tpdos: u64,
    /// TPDOs that never came, by the number of SYNCs sent.
    pub lost_tpdos: u64,
    /// Cycles with an actual position that is not worth the name: in an incomplete image, behind a
    /// backlog.
    pub unusable_positions: u64,
    /// Largest distance between target and actual position while targets went out, in steps.
    pub max_following_error: u64,
    /// Targets that the gateway reported as not sent.
    pub targets_lost: u64,
    /// Faults of the drive.
    pub faults: u64,
    /// Emergency messages.
    pub emergencies: u32,
    /// Most cycles in a row without a usable TPDO while the axis was enabled.
    pub longest_gap: u16,
    /// An igh_cia402_hold_t: why the axis held last.
    pub last_hold: u8,
    /// Not used.
    pub reserved: u8,
}

impl From<AxisStatistics> for igh_cia402_axis_statistics_t {
    fn from(from: AxisStatistics) -> Self {
        let none = igh_cia402_hold_t::IGH_CIA402_HOLD_NONE;
        Self {
            targets_sent: from.targets_sent,
            take_ups: from.take_ups,
            targets_refused: from.targets_refused,
            refused_step: from.refused_step,
            refused_window: from.refused_window,
            waits: from.waits,
            holds: from.holds,
            tpdos: from.tpdos,
            malformed_tpdos: from.malformed_tpdos,
            lost_tpdos: from.lost_tpdos,
            unusable_positions: from.unusable_positions,
            max_following_error: from.max_following_error,
            targets_lost: from.targets_lost,
            faults: from.faults,
            emergencies: from.emergencies,
            longest_gap: from.longest_gap,
            last_hold: from.last_hold.map_or(none, hold) as u8,
            reserved: 0,
        }
    }
}

/// What does not fit any more on a channel.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_load_warning_t {
    /// There is room for everything.
    IGH_CIA402_LOAD_OK = 0,
    /// Less than a tenth is left for SDO, heartbeats and emergencies.
    IGH_CIA402_LOAD_NO_RESERVE = 1,
    /// With unlucky data the bus is too slow for a cycle now and then.
    IGH_CIA402_LOAD_TIGHT = 2,
    /// More frames in a cycle than the gateway serves in one direction.
    IGH_CIA402_LOAD_BUDGET = 3,
    /// The bus is too slow for the cycle: targets pile up, and the axes will hold.
    IGH_CIA402_LOAD_TOO_MUCH = 4,
}

/// Load of one channel by the process data of its axes and SYNC. SDO, heartbeats and NMT need what
/// is left.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_cia402_bus_load_t {
    /// Share of the bus without a stuff bit; 1.0 is all of it.
    pub least: f64,
    /// Share of the bus with as many stuff bits as are possible.
    pub most: f64,
    /// Axes on the channel.
    pub axes: u32,
    /// Frames from the host per cycle.
    pub frames_out: u32,
    /// Frames from the drives per cycle.
    pub frames_in: u32,
    /// Slave index.
    pub slave: u16,
    /// Channel, 0 to 3.
    pub channel: u8,
    /// An igh_cia402_load_warning_t.
    pub warning: u8,
}

impl From<BusLoad> for igh_cia402_bus_load_t {
    fn from(from: BusLoad) -> Self {
        use igh_cia402_load_warning_t::*;
        let warning = match from.warning() {
            None => IGH_CIA402_LOAD_OK,
            Some(LoadWarning::NoReserve) => IGH_CIA402_LOAD_NO_RESERVE,
            Some(LoadWarning::Tight) => IGH_CIA402_LOAD_TIGHT,
            Some(LoadWarning::Budget) => IGH_CIA402_LOAD_BUDGET,
            Some(LoadWarning::TooMuch) => IGH_CIA402_LOAD_TOO_MUCH,
        };
        Self {
            least: from.least,
            most: from.most,
            axes: from.axes,
            frames_out: from.frames_out,
            frames_in: from.frames_in,
            slave: u16::try_from(from.slave).unwrap_or(u16::MAX),
            channel: from.channel,
            warning: warning as u8,
        }
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
    call("igh_cia402_get_axis_statistics", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        unsafe {
            let out = call.out("statistics", statistics)?;
            on_axes(call, context, |cia402, _| {
                need_axis(call, cia402, axis)?;
                out.set(cia402.statistics(axis).into());
                Ok(())
            })
        }
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
    call("igh_cia402_get_bus_load", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        unsafe {
            let mut room = call.room("loads", loads, capacity)?;
            let out = call.out("count", count)?;
            on_axes(call, context, |cia402, port| {
                let loads = cia402.bus_load(port);
                out.set(loads.len());
                if loads.iter().all(|load| room.push((*load).into())) {
                    return Ok(());
                }
                let words = format_args!("{} channels have axes, more than fit", loads.len());
                Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, words))
            })
        }
    })
}
