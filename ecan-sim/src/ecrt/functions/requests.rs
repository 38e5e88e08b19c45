//! SDO and register requests.

use super::{data_or_null, guarded, handle_or_null, on_config, on_reg_request, on_request, status};
use crate::ecrt::slave_config::RequestProgress;
use ecrt_sys::{
    EC_REQUEST_BUSY, EC_REQUEST_ERROR, EC_REQUEST_SUCCESS, EC_REQUEST_UNUSED, ec_reg_request_t,
    ec_request_state_t, ec_sdo_request_t, ec_slave_config_t,
};
use libc::{c_int, size_t};

two_forms!(
    /// `ecrt_sdo_request_index`: sets the object of a request.
    sdo_request_index / sdo_request_index_silent(
    request: *mut ec_sdo_request_t, index: u16, subindex: u8) {
    on_request(request)?.change(|request| {
        (request.index, request.subindex) = (index, subindex);
    })
});

two_forms!(
    /// `ecrt_sdo_request_timeout`: time that a request may take.
    sdo_request_timeout / sdo_request_timeout_silent(
    request: *mut ec_sdo_request_t, timeout_ms: u32) {
    on_request(request)?.change(|request| {
        request.timeout_ns = u64::from(timeout_ms) * 1_000_000;
    })
});

/// `ecrt_sdo_request_data`: a request's memory.
pub unsafe extern "C" fn sdo_request_data(request: *mut ec_sdo_request_t) -> *mut u8 {
    data_or_null(|| on_request(request)?.change(|request| request.memory.as_ptr()))
}

/// `ecrt_sdo_request_data_size`: bytes that a request holds.
pub unsafe extern "C" fn sdo_request_data_size(request: *const ec_sdo_request_t) -> size_t {
    guarded(|| on_request(request)?.change(|request| request.data_size)).unwrap_or(0)
}

pub(super) fn request_state(progress: RequestProgress) -> ec_request_state_t {
    match progress {
        RequestProgress::Unused => EC_REQUEST_UNUSED,
        RequestProgress::Queued | RequestProgress::Busy => EC_REQUEST_BUSY,
        RequestProgress::Success => EC_REQUEST_SUCCESS,
        RequestProgress::Failure => EC_REQUEST_ERROR,
    }
}

/// `ecrt_sdo_request_state`: state of a request; copies the data of a finished read.
pub unsafe extern "C" fn sdo_request_state(request: *mut ec_sdo_request_t) -> ec_request_state_t {
    guarded(|| on_request(request)?.progress()).map_or(EC_REQUEST_ERROR, request_state)
}

two_forms!(
    /// `ecrt_sdo_request_write`: starts a write.
    sdo_request_write / sdo_request_write_silent(request: *mut ec_sdo_request_t) {
    on_request(request)?.start(true)
});

two_forms!(
    /// `ecrt_sdo_request_read`: starts a read.
    sdo_request_read / sdo_request_read_silent(request: *mut ec_sdo_request_t) {
    on_request(request)?.start(false)
});

/// `ecrt_slave_config_create_reg_request`: a register request that runs in parallel with the cycle.
pub unsafe extern "C" fn slave_config_create_reg_request(
    config: *mut ec_slave_config_t,
    size: size_t,
) -> *mut ec_reg_request_t {
    handle_or_null(|| on_config(config).and_then(|call| call.create_reg_request(size)))
}

/// `ecrt_reg_request_data`: a register request's memory.
pub unsafe extern "C" fn reg_request_data(request: *mut ec_reg_request_t) -> *mut u8 {
    data_or_null(|| on_reg_request(request)?.change(|request| request.memory.as_ptr()))
}

/// `ecrt_reg_request_state`: state of a register request; copies the data of a finished read.
pub unsafe extern "C" fn reg_request_state(request: *mut ec_reg_request_t) -> ec_request_state_t {
    guarded(|| on_reg_request(request)?.change(|request| request.fetch()))
        .map_or(EC_REQUEST_ERROR, request_state)
}

two_forms!(
    /// `ecrt_reg_request_read`: starts reading a register.
    reg_request_read / reg_request_read_silent(
    request: *mut ec_reg_request_t, address: u16, size: size_t) {
    on_reg_request(request)?.start(false, address, size)
});

/// `ecrt_reg_request_write`: starts writing a register.
pub unsafe extern "C" fn reg_request_write(
    request: *mut ec_reg_request_t,
    address: u16,
    size: size_t,
) -> c_int {
    status(|| on_reg_request(request)?.start(true, address, size))
}
