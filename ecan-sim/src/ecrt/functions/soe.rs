//! SoE, which the gateway does not speak: every request ends in an error.

use super::{
    bytes, data_or_null, guarded, handle_or_null, on_config, on_master, on_soe_request, status,
};
use ecan_protocol::device::AlState;
use ecrt_sys::{
    EC_REQUEST_ERROR, EC_REQUEST_UNUSED, ec_al_state_t, ec_master_t, ec_request_state_t,
    ec_slave_config_t,
};
use libc::{c_int, size_t};

/// An SoE request, owned by its slave configuration. Only a name for a handle.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Debug)]
pub struct ec_soe_request_t {
    _opaque: [u8; 0],
}

/// `ecrt_master_write_idn`: `EIO` without an error code, as of a slave without SoE.
pub unsafe extern "C" fn master_write_idn(
    master: *mut ec_master_t,
    position: u16,
    _drive: u8,
    _idn: u16,
    data: *const u8,
    size: size_t,
    error_code: *mut u16,
) -> c_int {
    status(|| {
        let call = on_master(master)?;
        // SAFETY: the caller passes `size` bytes, or null.
        unsafe { bytes(data, size)? };
        call.slave(position, |_| Ok(()))?;
        // SAFETY: the caller passes a place for the code, or null.
        unsafe { no_error_code(error_code) };
        Err(libc::EIO)
    })
}

/// `ecrt_master_read_idn`: `EIO` without an error code, as of a slave without SoE.
pub unsafe extern "C" fn master_read_idn(
    master: *mut ec_master_t,
    position: u16,
    _drive: u8,
    _idn: u16,
    _target: *mut u8,
    _target_size: size_t,
    _result_size: *mut size_t,
    error_code: *mut u16,
) -> c_int {
    status(|| {
        on_master(master)?.slave(position, |_| Ok(()))?;
        // SAFETY: the caller passes a place for the code, or null.
        unsafe { no_error_code(error_code) };
        Err(libc::EIO)
    })
}

/// # Safety
/// `target` is null or valid for writing.
unsafe fn no_error_code(target: *mut u16) {
    // SAFETY: the caller's promise. Without a place for it the code goes nowhere.
    let _ = unsafe { super::store(target, 0) };
}

/// `ecrt_slave_config_idn`: an IDN to be written at every start, which keeps the slave from
/// leaving that state.
pub unsafe extern "C" fn slave_config_idn(
    config: *mut ec_slave_config_t,
    drive: u8,
    _idn: u16,
    state: ec_al_state_t,
    data: *const u8,
    size: size_t,
) -> c_int {
    status(|| {
        let call = on_config(config)?;
        // SAFETY: the caller passes `size` bytes, or null.
        unsafe { bytes(data, size)? };
        let state = u8::try_from(state).ok().and_then(AlState::from_raw).ok_or(libc::EINVAL)?;
        call.add_idn(drive, state)
    })
}

/// `ecrt_slave_config_create_soe_request`: a request, which will fail.
pub unsafe extern "C" fn slave_config_create_soe_request(
    config: *mut ec_slave_config_t,
    _drive: u8,
    _idn: u16,
    size: size_t,
) -> *mut ec_soe_request_t {
    handle_or_null(|| on_config(config)?.create_soe_request(size))
}

/// `ecrt_soe_request_idn`: points a request at another IDN.
pub unsafe extern "C" fn soe_request_idn(
    request: *mut ec_soe_request_t,
    _drive: u8,
    _idn: u16,
) -> c_int {
    status(|| on_soe_request(request).map(drop))
}

/// `ecrt_soe_request_timeout`: time that a request may take.
pub unsafe extern "C" fn soe_request_timeout(
    request: *mut ec_soe_request_t,
    _timeout_ms: u32,
) -> c_int {
    status(|| on_soe_request(request).map(drop))
}

/// `ecrt_soe_request_data`: a request's memory.
pub unsafe extern "C" fn soe_request_data(request: *const ec_soe_request_t) -> *mut u8 {
    data_or_null(|| on_soe_request(request)?.data())
}

/// `ecrt_soe_request_data_size`: bytes of that memory.
pub unsafe extern "C" fn soe_request_data_size(request: *const ec_soe_request_t) -> size_t {
    guarded(|| on_soe_request(request)?.size()).unwrap_or(0)
}

/// `ecrt_soe_request_state`: unused until it is started, then an error.
pub unsafe extern "C" fn soe_request_state(request: *mut ec_soe_request_t) -> ec_request_state_t {
    match guarded(|| on_soe_request(request)?.change(|request| request.failed)) {
        Ok(false) => EC_REQUEST_UNUSED,
        _ => EC_REQUEST_ERROR,
    }
}

/// `ecrt_soe_request_write`: starts a write, which fails.
pub unsafe extern "C" fn soe_request_write(request: *mut ec_soe_request_t) -> c_int {
    status(|| on_soe_request(request)?.start(None))
}

/// `ecrt_soe_request_read`: starts a read, which fails.
pub unsafe extern "C" fn soe_request_read(request: *mut ec_soe_request_t) -> c_int {
    status(|| on_soe_request(request)?.start(None))
}
