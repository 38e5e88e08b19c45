//! Distributed clocks in the cycle

use ecan_c_boundary::mirror;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_export::export;
use ecan_host::ClockStatus;

use super::context::ecan_igh_context_t;

mirror! {
    /// Differences between the clocks.
    #[derive(Default)]
    pub struct ecan_igh_clock_status_t from status: ClockStatus {
        /// Delay of the host against the reference clock in the last cycle with a reading, in
        /// nanoseconds, without the time that it is known to have waited and worked since the
        /// deadline.
        phase_error_ns: i32 = status.phase_error_ns.unwrap_or_default(),
        /// Rate of the host's clock minus that of the reference clock, in parts per billion; 0 if
        /// the host's clock leads.
        rate_ppb: i32,
        /// Upper estimate of the differences between the slaves' clocks, in nanoseconds.
        synchrony_ns: u32 = status.synchrony_ns.unwrap_or_default(),
        /// 1 if phase_error_ns is known.
        has_phase_error: u8 = status.phase_error_ns.is_some().into(),
        /// 1 if synchrony_ns is known.
        has_synchrony: u8 = status.synchrony_ns.is_some().into(),
        /// 1 if the mean phase error is below 0.2 % of the cycle.
        is_locked: u8,
        /// Zero.
        padding: u8 = 0,
        /// Cycles since the first reading whose frame was lost, so that the reference clock could
        /// not be read.
        missed_readings: u64,
        /// Zero; for fields of later versions.
        reserved: [u64; 3] = [0; 3],
    }
}

/// Gets the differences between the distributed clocks.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_ORDER without distributed clocks, before activation, and on an
///          attached context, whose owner serves the clocks.
#[export(call, layer adapter, into status)]
pub fn ecan_igh_get_clock_status(
    context: *mut ecan_igh_context_t,
    status: *mut ecan_igh_clock_status_t,
) {
    let status = adapter.clock_status().ok_or_else(|| {
        let text = format_args!("there are no distributed clocks in the cycle");
        call.fail(ecan_result_t::ECAN_ERR_ORDER, text)
    })?;
    Ok(status.into())
}

/// Returns the correction that an application with its own cycle timer adds to its next deadline,
/// to follow the reference clock. ecan_igh_wait_next_cycle() includes it.
///
/// @usage   rt, the cycle's thread, after receive
/// @return  Nanoseconds; 0 while the host's clock leads and if there is no context.
#[export(_, layer adapter, or 0)]
pub fn ecan_igh_clock_correction_ns(context: *mut ecan_igh_context_t) -> i64 {
    Ok(adapter.clock_correction_ns())
}
