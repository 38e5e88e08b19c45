use super::{
    data_or_null, guarded, handle_or_null, on_config, on_reg_request, on_request, with_reg_request,
    with_request,
};
use crate::ecrt::calls::CallResult;
use crate::ecrt::registry::Target;
use crate::ecrt::slave_config::{RegRequest, RequestId, RequestProgress, SdoRequest};
use ecrt_sys::{
    EC_REQUEST_BUSY, EC_REQUEST_ERROR, EC_REQUEST_SUCCESS, EC_REQUEST_UNUSED, ec_reg_request_t,
    ec_request_state_t, ec_sdo_request_t, ec_slave_config_t,
};
use libc::size_t;

pub unsafe extern "C" fn sdo_request_data(request: *mut ec_sdo_request_t) -> *mut u8 {
    data_or_null(|| with_request(request, |request| request.memory.as_ptr()))
}

pub unsafe extern "C" fn sdo_request_data_size(request: *const ec_sdo_request_t) -> size_t {
    guarded(|| with_request(request, |request| request.data_size)).unwrap_or(0)
}

fn request_state(progress: impl FnOnce() -> CallResult<RequestProgress>) -> ec_request_state_t {
    match guarded(progress) {
        Ok(RequestProgress::Unused) => EC_REQUEST_UNUSED,
        Ok(RequestProgress::Queued | RequestProgress::Busy) => EC_REQUEST_BUSY,
        Ok(RequestProgress::Success) => EC_REQUEST_SUCCESS,
        Ok(RequestProgress::Failure) | Err(_) => EC_REQUEST_ERROR,
    }
}

pub unsafe extern "C" fn sdo_request_state(request: *mut ec_sdo_request_t) -> ec_request_state_t {
    request_state(|| with_request(request, SdoRequest::fetch))
}

fn start_request(request: *mut ec_sdo_request_t, writes: bool) -> CallResult {
    let call = on_request(request)?;
    call.driving(|state| state.master.start_request(call.object, writes, state.world.now_ns()))
}

fn start_reg_request(
    request: *mut ec_reg_request_t,
    writes: bool,
    address: u16,
    size: size_t,
) -> CallResult {
    let call = on_reg_request(request)?;
    call.driving(|state| {
        let now = state.world.now_ns();
        state.master.start_reg_request(call.object, writes, address, size, now)
    })
}

pub unsafe extern "C" fn slave_config_create_reg_request(
    config: *mut ec_slave_config_t,
    size: size_t,
) -> *mut ec_reg_request_t {
    handle_or_null(|| {
        let call = on_config(config)?;
        let request = call.configuring(|state| {
            let requests = &mut state.master.config(call.object)?.reg_requests;
            requests.push(RegRequest::new(size));
            Ok(requests.len() - 1)
        })?;
        Ok(call.insert(Target::RegRequest(RequestId { config: call.object, request })))
    })
}

pub unsafe extern "C" fn reg_request_data(request: *mut ec_reg_request_t) -> *mut u8 {
    data_or_null(|| with_reg_request(request, |request| request.memory.as_ptr()))
}

pub unsafe extern "C" fn reg_request_state(request: *mut ec_reg_request_t) -> ec_request_state_t {
    request_state(|| with_reg_request(request, |request| request.fetch()))
}

functions! {
    two_forms sdo_request_index(request: *mut ec_sdo_request_t, index: u16, subindex: u8) {
        with_request(request, |request| (request.index, request.subindex) = (index, subindex))
    }

    two_forms sdo_request_timeout(request: *mut ec_sdo_request_t, timeout_ms: u32) {
        with_request(request, |request| request.timeout_ns = u64::from(timeout_ms) * 1_000_000)
    }

    two_forms sdo_request_write(request: *mut ec_sdo_request_t) {
        start_request(request, true)
    }

    two_forms sdo_request_read(request: *mut ec_sdo_request_t) {
        start_request(request, false)
    }

    two_forms reg_request_read(request: *mut ec_reg_request_t, address: u16, size: size_t) {
        start_reg_request(request, false, address, size)
    }

    /// Starts writing a register.
    two_forms reg_request_write(request: *mut ec_reg_request_t, address: u16, size: size_t) {
        start_reg_request(request, true, address, size)
    }
}
