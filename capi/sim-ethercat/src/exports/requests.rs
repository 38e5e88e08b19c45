//! SDO and register requests.

use ecrt_sys::{ec_reg_request_t, ec_request_state_t, ec_sdo_request_t, ec_slave_config_t};
use libc::{c_int, size_t};

export! {
    reported ecrt_slave_config_create_sdo_request(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, size: size_t)
        -> *mut ec_sdo_request_t = slave_config_create_sdo_request;
    silent ecrt_sdo_request_index(
        request: *mut ec_sdo_request_t, index: u16, subindex: u8) -> c_int = sdo_request_index;
    silent ecrt_sdo_request_timeout(request: *mut ec_sdo_request_t, timeout_ms: u32) -> c_int
        = sdo_request_timeout;
    silent ecrt_sdo_request_data(request: *mut ec_sdo_request_t) -> *mut u8 = sdo_request_data;
    silent ecrt_sdo_request_data_size(request: *const ec_sdo_request_t) -> size_t
        = sdo_request_data_size;
    silent ecrt_sdo_request_state(request: *mut ec_sdo_request_t) -> ec_request_state_t
        = sdo_request_state;
    silent ecrt_sdo_request_write(request: *mut ec_sdo_request_t) -> c_int = sdo_request_write;
    silent ecrt_sdo_request_read(request: *mut ec_sdo_request_t) -> c_int = sdo_request_read;

    reported ecrt_slave_config_create_reg_request(
        config: *mut ec_slave_config_t, size: size_t) -> *mut ec_reg_request_t
        = slave_config_create_reg_request;
    silent ecrt_reg_request_data(request: *mut ec_reg_request_t) -> *mut u8 = reg_request_data;
    silent ecrt_reg_request_state(request: *mut ec_reg_request_t) -> ec_request_state_t
        = reg_request_state;
    silent ecrt_reg_request_write(
        request: *mut ec_reg_request_t, address: u16, size: size_t) -> c_int = reg_request_write;
    silent ecrt_reg_request_read(
        request: *mut ec_reg_request_t, address: u16, size: size_t) -> c_int = reg_request_read;
}
