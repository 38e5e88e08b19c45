//! Counters and bus load
//!
//! Counters only grow.

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{mirror, pointers};
use ecan_c_export::export;
use ecan_cia402::{AxisStatistics, BusLoad, LoadWarning};

use super::context::{igh_cia402_context_t, need_axis};
use super::state_terms::igh_cia402_hold_t;

mirror! {
    /// Counters of an axis.
    pub struct igh_cia402_axis_statistics_t from rust: AxisStatistics {
        /// Targets passed to the gateway, the first ones included.
        targets_sent: u64,
        /// Times that the axis became active while enabled.
        activations: u64,
        /// Rejected targets of the application, for any reason.
        targets_rejected: u64,
        /// Targets rejected because of the step limit.
        rejected_step: u64,
        /// Targets rejected because of the following window.
        rejected_window: u64,
        /// Cycles in which an active axis got no target: an incomplete working counter, a repeated
        /// image, a full image.
        waits: u64,
        /// Times that the axis held.
        holds: u64,
        /// Times that the axis became uncontrolled: to be stopped, possibly moving, and silent.
        uncontrolled: u64,
        /// TPDOs received.
        tpdos: u64,
        /// TPDOs too short for the mapping.
        malformed_tpdos: u64,
        /// Lost TPDOs, by the number of sent SYNCs.
        lost_tpdos: u64,
        /// Cycles with an actual position that cannot be used: in an incomplete image, after a
        /// backlog.
        unusable_positions: u64,
        /// Largest distance between target and actual position while targets were sent, in steps.
        max_following_error: u64,
        /// Targets that the gateway reported as not sent.
        targets_lost: u64,
        /// Feed-forwards that a limit changed.
        feed_forwards_limited: u64,
        /// Faults of the drive.
        faults: u64,
        /// Emergency messages.
        emergencies: u32,
        /// Most consecutive cycles without a usable TPDO while the axis was enabled.
        longest_gap: u16,
        /// An igh_cia402_hold_t: reason of the last hold.
        last_hold: u8 = igh_cia402_hold_t::from(rust.last_hold) as u8,
        /// Zero.
        padding: u8 = 0,
        /// Zero; for fields of later versions.
        reserved: [u64; 8] = [0; 8],
    }
}

mirror! {
    /// Overload of a channel.
    pub enum igh_cia402_load_warning_t from Option<LoadWarning> {
        /// No overload.
        IGH_CIA402_LOAD_OK = 0 => None,
        /// Less than 10 % is left for SDO, heartbeats and emergencies.
        IGH_CIA402_LOAD_NO_RESERVE = 1 => Some(LoadWarning::NoReserve),
        /// In the worst case of stuff bits the bus is too slow for a cycle.
        IGH_CIA402_LOAD_TIGHT = 2 => Some(LoadWarning::Tight),
        /// More frames in a cycle than the gateway serves in one direction.
        IGH_CIA402_LOAD_BUDGET = 3 => Some(LoadWarning::Budget),
        /// The bus is too slow for the cycle: targets accumulate, and the axes will hold.
        IGH_CIA402_LOAD_TOO_MUCH = 4 => Some(LoadWarning::TooMuch),
    }
}

mirror! {
    /// Load of one channel by the process data of its axes and SYNC. SDO, heartbeats and NMT use
    /// the rest.
    pub struct igh_cia402_bus_load_t from rust: BusLoad {
        /// Share of the bus without stuff bits; 1.0 is 100 %.
        least: f64,
        /// Share of the bus with the most possible stuff bits.
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
        /// Zero; for fields of later versions.
        reserved: [u64; 4] = [0; 4],
    }
}

/// Counters of an axis.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _), into statistics)]
pub fn igh_cia402_get_axis_statistics(
    context: *mut igh_cia402_context_t,
    axis: usize,
    statistics: *mut igh_cia402_axis_statistics_t,
) {
    need_axis(call, cia402, axis)?;
    Ok(cia402.statistics(axis).into())
}

/// Gets the load of each CAN bus with axes by process data, by the bit rates of the Port.
///
/// @param loads     Gets the loads of the channels.
/// @param capacity  Channels that fit.
/// @param count     Gets the number of channels with axes, even if they do not all fit.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_BUFFER if not all fit.
#[export(call, layer(cia402, port))]
pub fn igh_cia402_get_bus_load(
    context: *mut igh_cia402_context_t,
    loads: *mut igh_cia402_bus_load_t,
    capacity: usize,
    count: *mut usize,
) {
    pointers!(call, room(loads, capacity), out(count));
    let found = cia402.bus_load(port);
    count.set(found.len());
    if found.iter().all(|load| loads.push((*load).into())) {
        return Ok(());
    }
    let text = format_args!("{} channels have axes, {capacity} fit", found.len());
    Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text))
}
