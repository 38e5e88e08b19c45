//! The master: bus state, transfers, phases.

use ecrt_sys::{
    ec_domain_t, ec_master_info_t, ec_master_link_state_t, ec_master_scan_progress_t,
    ec_master_state_t, ec_master_t, ec_pdo_entry_info_t, ec_pdo_info_t, ec_slave_config_t,
    ec_slave_info_t, ec_sync_info_t,
};
use libc::{c_int, c_uint, size_t};

export! {
    reported ecrt_master(master: *mut ec_master_t, info: *mut ec_master_info_t) -> c_int = master;
    reported ecrt_master_scan_progress(
        master: *mut ec_master_t, progress: *mut ec_master_scan_progress_t) -> c_int
        = master_scan_progress;
    reported ecrt_master_get_slave(
        master: *mut ec_master_t, position: u16, info: *mut ec_slave_info_t) -> c_int
        = master_get_slave;
    reported ecrt_master_get_sync_manager(
        master: *mut ec_master_t, position: u16, sync_index: u8, sync: *mut ec_sync_info_t)
        -> c_int = master_get_sync_manager;
    reported ecrt_master_get_pdo(
        master: *mut ec_master_t, position: u16, sync_index: u8, pdo_position: u16,
        pdo: *mut ec_pdo_info_t) -> c_int = master_get_pdo;
    reported ecrt_master_get_pdo_entry(
        master: *mut ec_master_t, position: u16, sync_index: u8, pdo_position: u16,
        entry_position: u16, entry: *mut ec_pdo_entry_info_t) -> c_int = master_get_pdo_entry;
    reported ecrt_master_sdo_download(
        master: *mut ec_master_t, position: u16, index: u16, subindex: u8, data: *const u8,
        size: size_t, abort_code: *mut u32) -> c_int = master_sdo_download;
    reported ecrt_master_sdo_download_complete(
        master: *mut ec_master_t, position: u16, index: u16, data: *const u8, size: size_t,
        abort_code: *mut u32) -> c_int = master_sdo_download_complete;
    reported ecrt_master_sdo_upload(
        master: *mut ec_master_t, position: u16, index: u16, subindex: u8, target: *mut u8,
        target_size: size_t, result_size: *mut size_t, abort_code: *mut u32) -> c_int
        = master_sdo_upload;
    silent ecrt_master_state(
        master: *const ec_master_t, state: *mut ec_master_state_t) -> c_int = master_state;
    reported ecrt_master_link_state(
        master: *const ec_master_t, device: c_uint, state: *mut ec_master_link_state_t) -> c_int
        = master_link_state;

    reported ecrt_master_create_domain(master: *mut ec_master_t) -> *mut ec_domain_t
        = master_create_domain;
    reported ecrt_master_slave_config(
        master: *mut ec_master_t, alias: u16, position: u16, vendor_id: u32, product_code: u32)
        -> *mut ec_slave_config_t = master_slave_config;
    reported ecrt_master_select_reference_clock(
        master: *mut ec_master_t, config: *mut ec_slave_config_t) -> c_int
        = master_select_reference_clock;
    silent ecrt_master_set_send_interval(master: *mut ec_master_t, interval_us: size_t) -> c_int
        = master_set_send_interval;
    reported ecrt_master_activate(master: *mut ec_master_t) -> c_int = master_activate;
    silent ecrt_master_deactivate(master: *mut ec_master_t) -> c_int = master_deactivate;
}
