//! The functions of the simulated master.
//!
//! # Safety
//! Out-parameters and buffers are NULL or valid, by the contract of libethercat.

use ecrt_sys::{
    ec_al_state_t, ec_direction_t, ec_domain_state_t, ec_domain_t, ec_master_info_t,
    ec_master_link_state_t, ec_master_scan_progress_t, ec_master_state_t, ec_master_t,
    ec_pdo_entry_info_t, ec_pdo_entry_reg_t, ec_pdo_info_t, ec_reg_request_t, ec_request_state_t,
    ec_sdo_request_t, ec_slave_config_state_t, ec_slave_config_t, ec_slave_info_t, ec_sync_info_t,
    ec_watchdog_mode_t,
};
use libc::{c_char, c_int, c_uint, size_t};

use crate::report::reported;

/// Exports functions of the simulator under their names in libethercat; a `status` is that of 1.6.
macro_rules! export {
    (@result status) => { c_int };
    (@result optional_status) => { c_int };
    (@result required) => { () };
    (@result $kind:ident $result:ty) => { $result };
    ($(
        $(#[$doc:meta])*
        $kind:ident $name:ident($($argument:ident: $type:ty),*) $(-> $result:ty)?;
    )*) => { $(
        #[unsafe(export_name = concat!("ecrt_", stringify!($name)))]
        pub unsafe extern "C" fn $name($($argument: $type),*) -> export!(@result $kind $($result)?) {
            // SAFETY: the same arguments under the same promises.
            let result = unsafe { ::ecan_sim::libethercat::$name($($argument),*) };
            reported(concat!("ecrt_", stringify!($name)), result)
        }
    )* };
}

ecrt_sys::for_each_function!(export);

// Functions that the SDK does not use.
export! {
    status master_reserve(master: *mut ec_master_t);
    status slave_config_pdos(
        config: *mut ec_slave_config_t, sync_count: c_uint, syncs: *const ec_sync_info_t);
    required slave_config_reg_pdo_entry_pos(
        config: *mut ec_slave_config_t, sync_index: u8, pdo_position: c_uint,
        entry_position: c_uint, domain: *mut ec_domain_t, bit_position: *mut c_uint) -> c_int;
    status slave_config_sdo8(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u8);
    status slave_config_sdo16(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u16);
    status slave_config_sdo32(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u32);
    status slave_config_complete_sdo(
        config: *mut ec_slave_config_t, index: u16, data: *const u8, size: size_t);
    status slave_config_emerg_clear(config: *mut ec_slave_config_t);
    status slave_config_emerg_overruns(config: *const ec_slave_config_t);
    status domain_reg_pdo_entry_list(
        domain: *mut ec_domain_t, entries: *const ec_pdo_entry_reg_t);
}
