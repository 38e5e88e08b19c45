//! Domains, exchange and clocks.

use ecrt_sys::{ec_domain_state_t, ec_domain_t, ec_master_t, ec_pdo_entry_reg_t};
use libc::{c_int, size_t};

export! {
    reported ecrt_domain_reg_pdo_entry_list(
        domain: *mut ec_domain_t, entries: *const ec_pdo_entry_reg_t) -> c_int
        = domain_reg_pdo_entry_list;
    silent ecrt_domain_size(domain: *const ec_domain_t) -> size_t = domain_size;
    silent ecrt_domain_data(domain: *mut ec_domain_t) -> *mut u8 = domain_data;
    silent ecrt_domain_process(domain: *mut ec_domain_t) -> c_int = domain_process;
    silent ecrt_domain_queue(domain: *mut ec_domain_t) -> c_int = domain_queue;
    silent ecrt_domain_state(
        domain: *const ec_domain_t, state: *mut ec_domain_state_t) -> c_int = domain_state;

    silent ecrt_master_send(master: *mut ec_master_t) -> c_int = master_send;
    silent ecrt_master_receive(master: *mut ec_master_t) -> c_int = master_receive;

    silent ecrt_master_application_time(master: *mut ec_master_t, time_ns: u64) -> c_int
        = master_application_time;
    silent ecrt_master_sync_reference_clock(master: *mut ec_master_t) -> c_int
        = master_sync_reference_clock;
    silent ecrt_master_sync_reference_clock_to(master: *mut ec_master_t, time_ns: u64) -> c_int
        = master_sync_reference_clock_to;
    silent ecrt_master_sync_slave_clocks(master: *mut ec_master_t) -> c_int
        = master_sync_slave_clocks;
    // the real library reports failures of this cycle function
    reported ecrt_master_reference_clock_time(master: *mut ec_master_t, time_ns: *mut u32) -> c_int
        = master_reference_clock_time;
    silent ecrt_master_sync_monitor_queue(master: *mut ec_master_t) -> c_int
        = master_sync_monitor_queue;
    silent ecrt_master_sync_monitor_process(master: *mut ec_master_t) -> u32
        = master_sync_monitor_process;
}
