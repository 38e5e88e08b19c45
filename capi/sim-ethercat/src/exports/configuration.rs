//! The configuration of a slave.

use ecrt_sys::{
    ec_al_state_t, ec_direction_t, ec_domain_t, ec_slave_config_state_t, ec_slave_config_t,
    ec_sync_info_t, ec_watchdog_mode_t,
};
use libc::{c_char, c_int, c_uint, size_t};

export! {
    reported ecrt_slave_config_sync_manager(
        config: *mut ec_slave_config_t, sync_index: u8, direction: ec_direction_t,
        watchdog: ec_watchdog_mode_t) -> c_int = slave_config_sync_manager;
    reported ecrt_slave_config_watchdog(
        config: *mut ec_slave_config_t, divider: u16, intervals: u16) -> c_int
        = slave_config_watchdog;
    reported ecrt_slave_config_pdo_assign_add(
        config: *mut ec_slave_config_t, sync_index: u8, pdo_index: u16) -> c_int
        = slave_config_pdo_assign_add;
    reported ecrt_slave_config_pdo_assign_clear(
        config: *mut ec_slave_config_t, sync_index: u8) -> c_int = slave_config_pdo_assign_clear;
    reported ecrt_slave_config_pdo_mapping_add(
        config: *mut ec_slave_config_t, pdo_index: u16, entry_index: u16, entry_subindex: u8,
        entry_bits: u8) -> c_int = slave_config_pdo_mapping_add;
    reported ecrt_slave_config_pdo_mapping_clear(
        config: *mut ec_slave_config_t, pdo_index: u16) -> c_int = slave_config_pdo_mapping_clear;
    reported ecrt_slave_config_pdos(
        config: *mut ec_slave_config_t, sync_count: c_uint, syncs: *const ec_sync_info_t) -> c_int
        = slave_config_pdos;
    reported ecrt_slave_config_reg_pdo_entry(
        config: *mut ec_slave_config_t, entry_index: u16, entry_subindex: u8,
        domain: *mut ec_domain_t, bit_position: *mut c_uint) -> c_int
        = slave_config_reg_pdo_entry;
    reported ecrt_slave_config_reg_pdo_entry_pos(
        config: *mut ec_slave_config_t, sync_index: u8, pdo_place: c_uint, entry_place: c_uint,
        domain: *mut ec_domain_t, bit_position: *mut c_uint) -> c_int
        = slave_config_reg_pdo_entry_pos;
    silent ecrt_slave_config_dc(
        config: *mut ec_slave_config_t, assign_activate: u16, sync0_cycle: u32, sync0_shift: i32,
        sync1_cycle: u32, sync1_shift: i32) -> c_int = slave_config_dc;
    reported ecrt_slave_config_sdo(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, data: *const u8, size: size_t)
        -> c_int = slave_config_sdo;
    reported ecrt_slave_config_sdo8(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u8) -> c_int
        = slave_config_sdo8;
    reported ecrt_slave_config_sdo16(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u16) -> c_int
        = slave_config_sdo16;
    reported ecrt_slave_config_sdo32(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u32) -> c_int
        = slave_config_sdo32;
    reported ecrt_slave_config_complete_sdo(
        config: *mut ec_slave_config_t, index: u16, data: *const u8, size: size_t) -> c_int
        = slave_config_complete_sdo;
    reported ecrt_slave_config_flag(
        config: *mut ec_slave_config_t, key: *const c_char, value: i32) -> c_int
        = slave_config_flag;
    reported ecrt_slave_config_state_timeout(
        config: *mut ec_slave_config_t, from: ec_al_state_t, to: ec_al_state_t,
        timeout_ms: c_uint) -> c_int = slave_config_state_timeout;
    silent ecrt_slave_config_state(
        config: *const ec_slave_config_t, state: *mut ec_slave_config_state_t) -> c_int
        = slave_config_state;

    reported ecrt_slave_config_emerg_size(
        config: *mut ec_slave_config_t, elements: size_t) -> c_int = slave_config_emerg_size;
    // programs poll for messages in the cycle; no message is not a failure
    silent ecrt_slave_config_emerg_pop(
        config: *mut ec_slave_config_t, target: *mut u8) -> c_int = slave_config_emerg_pop;
    reported ecrt_slave_config_emerg_clear(config: *mut ec_slave_config_t) -> c_int
        = slave_config_emerg_clear;
    reported ecrt_slave_config_emerg_overruns(config: *const ec_slave_config_t) -> c_int
        = slave_config_emerg_overruns;
}
