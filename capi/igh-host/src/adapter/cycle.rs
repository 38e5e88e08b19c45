//! The cycle of the Adapter, its clocks and process data.

use std::ffi::c_int;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, OutPointer, mirror, pointers};
use ecan_c_export::export;
use ecan_host::{Adapter, ClockStatus, CycleError, Delivery, DomainReport, WcState};

use super::bus_state::need_slave;
use super::context::ecan_igh_context_t;
use crate::bus::Bus;
use crate::errors::OrCode as _;
use crate::handle::Entered;

// Section: The cycle
//
// With a Port on the context use igh_mcan_port_cycle_begin() and igh_mcan_port_cycle_end(), which
// call these.

mirror! {
    /// Delivery of one direction in the last exchange, by the working counter.
    pub enum ecan_igh_delivery_t from Delivery {
        /// There was no exchange yet.
        ECAN_IGH_DELIVERY_NONE = 0 => Delivery::None,
        /// The image was delivered.
        ECAN_IGH_DELIVERY_CONFIRMED = 1 => Delivery::Confirmed,
        /// The image was not delivered.
        ECAN_IGH_DELIVERY_MISSED = 2 => Delivery::Missed,
        /// Unknown: one of two datagrams counted.
        ECAN_IGH_DELIVERY_UNKNOWN = 3 => Delivery::Unknown,
    }
}

mirror! {
    /// Result of the last exchange with one slave.
    #[derive(Default)]
    pub struct ecan_igh_domain_report_t from report: DomainReport {
        /// Working counter of the slave's domain.
        working_counter: u32,
        /// Working counter of a complete exchange.
        expected_working_counter: u32,
        /// Evaluation by the master, which is decisive: 0 nothing, 1 incomplete, 2 complete.
        wc_state: u8 = match report.wc_state {
            WcState::Zero => 0,
            WcState::Incomplete => 1,
            WcState::Complete => 2,
        },
        /// Delivery of the RxPDO: an ecan_igh_delivery_t.
        outputs: u8 = ecan_igh_delivery_t::from(report.outputs) as u8,
        /// Delivery of the TxPDO: an ecan_igh_delivery_t.
        inputs: u8 = ecan_igh_delivery_t::from(report.inputs) as u8,
        /// 1 if both directions were exchanged, else 0.
        is_complete: u8 = report.is_complete().into(),
        /// Zero; for fields of later versions.
        reserved: [u32; 5] = [0; 5],
    }
}

/// Runs one half of a cycle. With a Port it would tear the Port's images.
fn exchange(
    call: Call,
    bus: &mut Entered<Bus>,
    claim: impl FnOnce(&Entered<Bus>, Call) -> Result<(), ecan_result_t>,
    half: impl FnOnce(&mut Adapter) -> Result<(), CycleError>,
) -> Result<(), ecan_result_t> {
    if bus.port_mut().is_some() {
        let text = format_args!("there is a Port on it: call igh_mcan_port_cycle_begin and _end");
        return Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text));
    }
    claim(bus, call)?;
    half(bus.need_adapter(call)?).or_code(call)
}

/// Receives the process data and evaluates the working counters. First in the cycle.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_MASTER if a call of the library failed: the cycle may continue;
///          ECAN_ERR_ORDER if the bus is not active or there is a Port on it.
#[export(call, bus bus)]
pub fn ecan_igh_receive(context: *mut ecan_igh_context_t) {
    exchange(call, bus, Entered::begin_cycle, Adapter::receive)
}

/// Sends the process data. Last in the cycle.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  As ecan_igh_receive().
#[export(call, bus bus)]
pub fn ecan_igh_send(context: *mut ecan_igh_context_t) {
    exchange(call, bus, Entered::end_cycle, Adapter::send)
}

/// Sleeps until the next deadline of the cycle, on a grid of the configured period that never
/// drifts. In a stepped simulation time passes here.
///
/// A cycle lasts until the response of the bus is back, ecan_igh_response_ns() after the last send;
/// after a late cycle the next deadline may be missed by this time. A datagram that is sent again
/// before it is back loses its response and the received frames in it. An application with its own
/// timer must leave that time, too.
///
/// @usage   rt, the cycle's thread, active bus
#[export(call, bus bus)]
pub fn ecan_igh_wait_next_cycle(context: *mut ecan_igh_context_t) {
    bus.wait_next_cycle(call)
}

/// Returns the time of the master's clock: CLOCK_MONOTONIC, or the simulation's.
///
/// @usage   rt, the cycle's thread, after init
/// @return  Nanoseconds; 0 if there is no context.
#[export(_, layer adapter, or 0)]
pub fn ecan_igh_now_ns(context: *mut ecan_igh_context_t) -> u64 {
    Ok(adapter.clock().now_ns())
}

/// Returns the deadline of the running cycle on the clock of ecan_igh_now_ns(). Sync0 refers to it,
/// however late the wake-up was.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  Nanoseconds; 0 before the first cycle and if there is no context.
#[export(_, layer adapter, or 0)]
pub fn ecan_igh_cycle_time_ns(context: *mut ecan_igh_context_t) -> u64 {
    Ok(adapter.cycle_time_ns())
}

/// Returns how long the cycle waits for the response of the bus: its time on the wire, through the
/// slaves and through the host.
///
/// @usage   rt, the cycle's thread, after init
/// @return  Nanoseconds; 0 if there is no context.
#[export(_, layer adapter, or 0)]
pub fn ecan_igh_response_ns(context: *mut ecan_igh_context_t) -> u64 {
    Ok(adapter.response_ns())
}

/// Returns 1 if every slave exchanged both directions in the last cycle. Do not advance motion
/// otherwise (manual 15.5.2, step 8).
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
#[export(_, layer adapter, or 0)]
pub fn ecan_igh_domain_is_complete(context: *mut ecan_igh_context_t) -> c_int {
    Ok(adapter.domain_is_complete().into())
}

/// Gets the result of the last exchange with one slave.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer adapter, into report)]
pub fn ecan_igh_get_domain_report(
    context: *mut ecan_igh_context_t,
    slave: usize,
    report: *mut ecan_igh_domain_report_t,
) {
    need_slave(call, adapter, slave)?;
    Ok(adapter.domain_report(slave).into())
}

// Section: Distributed clocks in the cycle

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

// Section: Raw process data (manual 15.5.3)
//
// With a Port on the context the RxPDO belongs to the Port: read it, but do not write to it.

/// Stores the address and the size of an image.
fn put_image<P>(
    call: Call,
    address: OutPointer<P>,
    size: OutPointer<usize>,
    (start, bytes): (P, usize),
) -> Result<(), ecan_result_t> {
    if bytes == 0 {
        let text = format_args!("there are no process data before the bus is active");
        return Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text));
    }
    address.set(start);
    size.set(bytes);
    Ok(())
}

/// Gets the RxPDO of a slave, which the master sends to it: 128 * N continuous bytes to write the
/// next image into, with igh_mcan_pdo_writer_begin() for example.
///
/// @param rxpdo       Gets the address. Valid until the context is reconfigured or ends.
/// @param rxpdo_size  Gets the bytes.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_ORDER before the bus is active; ECAN_ERR_SLAVE.
#[export(call, layer adapter)]
pub fn ecan_igh_get_rxpdo_buffer(
    context: *mut ecan_igh_context_t,
    slave: usize,
    rxpdo: *mut *mut u8,
    rxpdo_size: *mut usize,
) {
    pointers!(call, out(rxpdo), out(rxpdo_size));
    need_slave(call, adapter, slave)?;
    let image = adapter.rx_pdo_mut(slave);
    put_image(call, rxpdo, rxpdo_size, (image.as_mut_ptr(), image.len()))
}

/// Gets the TxPDO of a slave as of the last receive: 128 * N continuous bytes, for
/// igh_mcan_pdo_parse_frames_ex() for example.
///
/// @param txpdo       Gets the address. Valid until the context is reconfigured or ends; the
///                    content changes with every receive.
/// @param txpdo_size  Gets the bytes.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  As ecan_igh_get_rxpdo_buffer().
#[export(call, layer adapter)]
pub fn ecan_igh_get_txpdo_buffer(
    context: *mut ecan_igh_context_t,
    slave: usize,
    txpdo: *mut *const u8,
    txpdo_size: *mut usize,
) {
    pointers!(call, out(txpdo), out(txpdo_size));
    need_slave(call, adapter, slave)?;
    let image = adapter.tx_pdo(slave);
    put_image(call, txpdo, txpdo_size, (image.as_ptr(), image.len()))
}
