//! The cycle
//!
//! With a Port on the context use igh_mcan_port_cycle_begin() and igh_mcan_port_cycle_end(), which
//! call these.

use std::ffi::c_int;

use ecan_host::{Delivery, DomainReport, WcState};
use ecan_mcan_host::boundary::{Call, call, getter};
use ecan_mcan_host::common::result::ecan_result_t;

use super::config::no_slave;
use super::context::ecan_igh_context_t;
use crate::bus;
use crate::errors;

/// What the working counter tells about one direction of the last exchange.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ecan_igh_delivery_t {
    /// Nothing was exchanged yet.
    ECAN_IGH_DELIVERY_NONE = 0,
    /// The image was taken over.
    ECAN_IGH_DELIVERY_CONFIRMED = 1,
    /// It was not.
    ECAN_IGH_DELIVERY_MISSED = 2,
    /// It cannot be told: one of two datagrams counted.
    ECAN_IGH_DELIVERY_UNKNOWN = 3,
}

/// Outcome of the last exchange with one slave.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ecan_igh_domain_report_t {
    /// Working counter of the slave's domain.
    pub working_counter: u32,
    /// Working counter of a complete exchange.
    pub expected_working_counter: u32,
    /// The master's judgement, which counts: 0 nothing, 1 incomplete, 2 complete.
    pub wc_state: u8,
    /// What became of the RxPDO: an ecan_igh_delivery_t.
    pub outputs: u8,
    /// Whether a TxPDO was fetched: an ecan_igh_delivery_t.
    pub inputs: u8,
    /// 1 where both directions were exchanged, else 0.
    pub is_complete: u8,
}

fn delivery(delivery: Delivery) -> u8 {
    let value = match delivery {
        Delivery::None => ecan_igh_delivery_t::ECAN_IGH_DELIVERY_NONE,
        Delivery::Confirmed => ecan_igh_delivery_t::ECAN_IGH_DELIVERY_CONFIRMED,
        Delivery::Missed => ecan_igh_delivery_t::ECAN_IGH_DELIVERY_MISSED,
        Delivery::Unknown => ecan_igh_delivery_t::ECAN_IGH_DELIVERY_UNKNOWN,
    };
    value as u8
}

impl From<DomainReport> for ecan_igh_domain_report_t {
    fn from(report: DomainReport) -> Self {
        Self {
            working_counter: report.working_counter,
            expected_working_counter: report.expected_working_counter,
            wc_state: match report.wc_state {
                WcState::Zero => 0,
                WcState::Incomplete => 1,
                WcState::Complete => 2,
            },
            outputs: delivery(report.outputs),
            inputs: delivery(report.inputs),
            is_complete: report.is_complete().into(),
        }
    }
}

/// A cycle by hand would tear the images of a Port.
fn need_no_port(call: Call, bus: &mut bus::Bus) -> Result<(), ecan_result_t> {
    if bus.port_mut().is_none() {
        return Ok(());
    }
    let words = format_args!("there is a Port on it: call igh_mcan_port_cycle_begin and _end");
    Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, words))
}

/// First in the cycle: fetches the process data and judges the working counters.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_MASTER where a call of the library failed, and the cycle may go on;
///          ECAN_ERR_ORDER where the bus is not active or there is a Port on it; ECAN_ERR_NULL,
///          ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_receive(context: *mut ecan_igh_context_t) -> c_int {
    call("ecan_igh_receive", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let mut bus = unsafe { bus::enter(call, context.cast())? };
        need_no_port(call, &mut bus)?;
        let received = bus.need_adapter(call)?.receive();
        received.map_err(|error| errors::cycle(call, &error))
    })
}

/// Last in the cycle: sends the process data.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  As ecan_igh_receive().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_send(context: *mut ecan_igh_context_t) -> c_int {
    call("ecan_igh_send", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let mut bus = unsafe { bus::enter(call, context.cast())? };
        need_no_port(call, &mut bus)?;
        let sent = bus.need_adapter(call)?.send();
        sent.map_err(|error| errors::cycle(call, &error))
    })
}

/// Sleeps until the next cycle is due, on a grid of the configured period that never drifts. On a
/// stepped simulation this is where time passes.
///
/// A cycle lasts until the answer of the bus is back, ecan_igh_response_ns() behind the last send; one
/// that came late may miss the next point by that. A datagram that is sent again before it is back
/// loses its answer, and with it the received frames in it. An application with a timer of its own
/// has to leave that time, too.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_wait_next_cycle(context: *mut ecan_igh_context_t) -> c_int {
    call("ecan_igh_wait_next_cycle", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let mut bus = unsafe { bus::enter(call, context.cast())? };
        bus.need_adapter(call)?.wait_next_cycle();
        Ok(())
    })
}

/// Time of the clock that the master lives in: CLOCK_MONOTONIC, or the simulation's.
///
/// @usage   rt, the cycle's thread, after init
/// @return  Nanoseconds; 0 where there is no context.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_now_ns(context: *mut ecan_igh_context_t) -> u64 {
    getter(
        "ecan_igh_now_ns",
        |_| 0,
        |call| {
            // SAFETY: the pointer is C's, valid or NULL as the header demands.
            let mut bus = unsafe { bus::enter(call, context.cast())? };
            Ok(bus.need_adapter(call)?.clock().now_ns())
        },
    )
}

/// The point of the grid on which the running cycle stands, on the clock of ecan_igh_now_ns(): to it
/// Sync0 refers, whatever the wake-up was late.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  Nanoseconds; 0 before the first cycle and where there is no context.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_cycle_time_ns(context: *mut ecan_igh_context_t) -> u64 {
    getter(
        "ecan_igh_cycle_time_ns",
        |_| 0,
        |call| {
            // SAFETY: the pointer is C's, valid or NULL as the header demands.
            let mut bus = unsafe { bus::enter(call, context.cast())? };
            Ok(bus.need_adapter(call)?.cycle_time_ns())
        },
    )
}

/// How long the answer of the bus to what was sent is waited for: its time on the wire, through the
/// slaves and through the host.
///
/// @usage   rt, the cycle's thread, after init
/// @return  Nanoseconds; 0 where there is no context.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_response_ns(context: *mut ecan_igh_context_t) -> u64 {
    getter(
        "ecan_igh_response_ns",
        |_| 0,
        |call| {
            // SAFETY: the pointer is C's, valid or NULL as the header demands.
            let mut bus = unsafe { bus::enter(call, context.cast())? };
            Ok(bus.need_adapter(call)?.response_ns())
        },
    )
}

/// Whether every slave exchanged both directions in the last cycle. Do not advance motion where
/// it did not (manual 15.5.2, step 8).
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY. Compare with 1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_domain_is_complete(context: *mut ecan_igh_context_t) -> c_int {
    getter(
        "ecan_igh_domain_is_complete",
        |error| error.code(),
        |call| {
            // SAFETY: the pointer is C's, valid or NULL as the header demands.
            let mut bus = unsafe { bus::enter(call, context.cast())? };
            Ok(bus.need_adapter(call)?.domain_is_complete().into())
        },
    )
}

/// The outcome of the last exchange with one slave.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_get_domain_report(
    context: *mut ecan_igh_context_t,
    slave: usize,
    report: *mut ecan_igh_domain_report_t,
) -> c_int {
    call("ecan_igh_get_domain_report", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter(call, context.cast())?, call.out("report", report)?) };
        let adapter = bus.need_adapter(call)?;
        let count = adapter.slave_count();
        if slave >= count {
            return Err(no_slave(call, slave, count));
        }
        out.set(adapter.domain_report(slave).into());
        Ok(())
    })
}
