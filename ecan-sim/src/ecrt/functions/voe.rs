//! VoE, which the gateway does not speak: every transfer ends in an error.

use super::{data_or_null, guarded, handle_or_null, on_config, on_voe_handler, status, store};
use ecrt_sys::{EC_REQUEST_ERROR, EC_REQUEST_UNUSED, ec_request_state_t, ec_slave_config_t};
use libc::{c_int, size_t};

/// A VoE handler, owned by its slave configuration. Only a name for a handle.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Debug)]
pub struct ec_voe_handler_t {
    _opaque: [u8; 0],
}

/// `ecrt_slave_config_create_voe_handler`: a handler, whose transfers will fail.
pub unsafe extern "C" fn slave_config_create_voe_handler(
    config: *mut ec_slave_config_t,
    size: size_t,
) -> *mut ec_voe_handler_t {
    handle_or_null(|| on_config(config)?.create_voe_handler(size))
}

/// `ecrt_voe_handler_send_header`: what sent messages begin with.
pub unsafe extern "C" fn voe_handler_send_header(
    handler: *mut ec_voe_handler_t,
    _vendor_id: u32,
    _vendor_type: u16,
) -> c_int {
    status(|| on_voe_handler(handler).map(drop))
}

/// `ecrt_voe_handler_received_header`: zeros, as nothing was received.
pub unsafe extern "C" fn voe_handler_received_header(
    handler: *const ec_voe_handler_t,
    vendor_id: *mut u32,
    vendor_type: *mut u16,
) -> c_int {
    status(|| {
        on_voe_handler(handler)?;
        // SAFETY: the caller passes places for both, or null.
        unsafe {
            store(vendor_id, 0)?;
            store(vendor_type, 0)
        }
    })
}

/// `ecrt_voe_handler_data`: a handler's memory.
pub unsafe extern "C" fn voe_handler_data(handler: *const ec_voe_handler_t) -> *mut u8 {
    data_or_null(|| on_voe_handler(handler)?.data())
}

/// `ecrt_voe_handler_data_size`: bytes of that memory.
pub unsafe extern "C" fn voe_handler_data_size(handler: *const ec_voe_handler_t) -> size_t {
    guarded(|| on_voe_handler(handler)?.size()).unwrap_or(0)
}

/// `ecrt_voe_handler_write`: starts a write, which fails.
pub unsafe extern "C" fn voe_handler_write(handler: *mut ec_voe_handler_t, size: size_t) -> c_int {
    status(|| on_voe_handler(handler)?.start(Some(size)))
}

/// `ecrt_voe_handler_read`: starts a read, which fails.
pub unsafe extern "C" fn voe_handler_read(handler: *mut ec_voe_handler_t) -> c_int {
    status(|| on_voe_handler(handler)?.start(None))
}

/// `ecrt_voe_handler_read_nosync`: starts a read, which fails.
pub unsafe extern "C" fn voe_handler_read_nosync(handler: *mut ec_voe_handler_t) -> c_int {
    status(|| on_voe_handler(handler)?.start(None))
}

/// `ecrt_voe_handler_execute`: unused until a transfer is started, then an error.
pub unsafe extern "C" fn voe_handler_execute(handler: *mut ec_voe_handler_t) -> ec_request_state_t {
    match guarded(|| on_voe_handler(handler)?.change(|handler| handler.failed)) {
        Ok(false) => EC_REQUEST_UNUSED,
        _ => EC_REQUEST_ERROR,
    }
}
