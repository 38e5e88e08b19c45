//! Process data, exchange and clocks.

use super::{data_or_null, guarded, on_domain, on_master, status, store};
use crate::ecrt::datagram::Queued;
use ecrt_sys::{
    EC_WC_COMPLETE, EC_WC_INCOMPLETE, EC_WC_ZERO, ec_domain_state_t, ec_domain_t, ec_master_t,
};
use libc::{c_int, size_t};

/// `ecrt_domain_size`: bytes of a domain.
pub unsafe extern "C" fn domain_size(domain: *const ec_domain_t) -> size_t {
    guarded(|| on_domain(domain)?.size()).unwrap_or(size_t::MAX)
}

/// `ecrt_domain_data`: a domain's memory; null before activation.
pub unsafe extern "C" fn domain_data(domain: *mut ec_domain_t) -> *mut u8 {
    data_or_null(|| Ok(on_domain(domain)?.memory()?.as_ptr()))
}

two_forms!(
    /// `ecrt_domain_process`: evaluates the received datagrams.
    domain_process / domain_process_silent(domain: *mut ec_domain_t) {
    on_domain(domain)?.process()
});

two_forms!(
    /// `ecrt_domain_queue`: queues a domain's datagrams.
    domain_queue / domain_queue_silent(domain: *mut ec_domain_t) {
    on_domain(domain)?.queue()
});

two_forms!(
    /// `ecrt_domain_state`: working counter of the last exchange.
    domain_state / domain_state_silent(
    domain: *const ec_domain_t, state: *mut ec_domain_state_t) {
    let (counter, expected) = on_domain(domain)?.counters()?;
    let value = ec_domain_state_t {
        working_counter: counter,
        wc_state: match counter {
            0 => EC_WC_ZERO,
            counter if counter == expected => EC_WC_COMPLETE,
            _ => EC_WC_INCOMPLETE,
        },
        redundancy_active: 0,
    };
    // SAFETY: the caller passes a place for the state, or null.
    unsafe { store(state, value) }
});

two_forms!(
    /// `ecrt_master_send`: sends everything queued.
    master_send / master_send_silent(master: *mut ec_master_t) {
    on_master(master)?.send()
});

two_forms!(
    /// `ecrt_master_receive`: receives the returned frames.
    master_receive / master_receive_silent(master: *mut ec_master_t) {
    on_master(master)?.receive()
});

two_forms!(
    /// `ecrt_master_application_time`: sets the application time.
    master_application_time / master_application_time_silent(
    master: *mut ec_master_t, time_ns: u64) {
    on_master(master)?.driving(|state| {
        let now = state.world.now_ns();
        state.master.clocks.application_time(time_ns, now);
    })
});

two_forms!(
    /// `ecrt_master_sync_reference_clock`: queues the reference clock's correction to the application time.
    master_sync_reference_clock / master_sync_reference_clock_silent(
    master: *mut ec_master_t) {
    on_master(master)?.queue_clock(Queued::ReferenceClock, None)
});

two_forms!(
    /// `ecrt_master_sync_reference_clock_to`: the same to a given time.
    master_sync_reference_clock_to / master_sync_reference_clock_to_silent(
    master: *mut ec_master_t, time_ns: u64) {
    on_master(master)?.queue_clock(Queued::ReferenceClock, Some(time_ns))
});

two_forms!(
    /// `ecrt_master_sync_slave_clocks`: queues the other clocks' correction.
    master_sync_slave_clocks / master_sync_slave_clocks_silent(
    master: *mut ec_master_t) {
    on_master(master)?.queue_clock(Queued::SlaveClocks, None)
});

/// `ecrt_master_reference_clock_time`: lower half of the reference clock.
pub unsafe extern "C" fn master_reference_clock_time(
    master: *mut ec_master_t,
    time_ns: *mut u32,
) -> c_int {
    status(|| {
        let call = on_master(master)?;
        let value = call.reference_clock_time()?;
        // SAFETY: the caller passes a place for the time, or null.
        unsafe { store(time_ns, value) }
    })
}

two_forms!(
    /// `ecrt_master_sync_monitor_queue`: queues the measurement of the clocks' difference.
    master_sync_monitor_queue / master_sync_monitor_queue_silent(
    master: *mut ec_master_t) {
    on_master(master)?.queue_clock(Queued::ClockMonitor, None)
});

/// `ecrt_master_sync_monitor_process`: largest difference of the clocks.
pub unsafe extern "C" fn master_sync_monitor_process(master: *mut ec_master_t) -> u32 {
    guarded(|| on_master(master)?.sync_monitor()).unwrap_or(u32::MAX)
}
