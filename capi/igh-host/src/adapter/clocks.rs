//! Distributed clocks in the cycle

use std::ffi::c_int;

use ecan_host::ClockStatus;
use ecan_mcan_host::boundary::{call, getter};
use ecan_mcan_host::common::result::ecan_result_t;

use super::context::ecan_igh_context_t;
use crate::bus;

/// How far the clocks are apart.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ecan_igh_clock_status_t {
    /// How late the host was against the reference clock in the last cycle that tells, in
    /// nanoseconds, without what it is known to have waited and worked since the point of its grid.
    pub phase_error_ns: i32,
    /// How much faster the host's clock runs than the reference clock, in parts per billion; 0
    /// while the host's clock leads.
    pub rate_ppb: i32,
    /// Upper estimate of the differences between the slaves' clocks, in nanoseconds.
    pub synchrony_ns: u32,
    /// 1 where phase_error_ns is known.
    pub has_phase_error: u8,
    /// 1 where synchrony_ns is known.
    pub has_synchrony: u8,
    /// 1 where the phase errors have become small: below 0.2 % of the cycle in the mean.
    pub is_locked: u8,
    /// Not used.
    pub reserved: u8,
    /// Cycles since the first reading whose frame did not come back, so that the reference clock
    /// could not be read.
    pub missed_readings: u64,
}

impl From<ClockStatus> for ecan_igh_clock_status_t {
    fn from(status: ClockStatus) -> Self {
        Self {
            phase_error_ns: status.phase_error_ns.unwrap_or_default(),
            rate_ppb: status.rate_ppb,
            synchrony_ns: status.synchrony_ns.unwrap_or_default(),
            has_phase_error: status.phase_error_ns.is_some().into(),
            has_synchrony: status.synchrony_ns.is_some().into(),
            is_locked: status.is_locked.into(),
            reserved: 0,
            missed_readings: status.missed_readings,
        }
    }
}

/// How far the distributed clocks are apart.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_ORDER without distributed clocks, before activation, and on an attached
///          context, whose owner serves the clocks; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
///          ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_get_clock_status(
    context: *mut ecan_igh_context_t,
    status: *mut ecan_igh_clock_status_t,
) -> c_int {
    call("ecan_igh_get_clock_status", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter(call, context.cast())?, call.out("status", status)?) };
        let status = bus.need_adapter(call)?.clock_status().ok_or_else(|| {
            let words = format_args!("there are no distributed clocks in the cycle");
            call.fail(ecan_result_t::ECAN_ERR_ORDER, words)
        })?;
        out.set(status.into());
        Ok(())
    })
}

/// What an application with a cycle timer of its own adds to its next deadline, so that it follows
/// the reference clock. ecan_igh_wait_next_cycle() has it in already.
///
/// @usage   rt, the cycle's thread, after receive
/// @return  Nanoseconds; 0 while the host's clock leads and where there is no context.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_clock_correction_ns(context: *mut ecan_igh_context_t) -> i64 {
    getter(
        "ecan_igh_clock_correction_ns",
        |_| 0,
        |call| {
            // SAFETY: the pointer is C's, valid or NULL as the header demands.
            let mut bus = unsafe { bus::enter(call, context.cast())? };
            Ok(bus.need_adapter(call)?.clock_correction_ns())
        },
    )
}
