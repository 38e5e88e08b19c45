//! Functions for process data, the exchange, clocks, requests and SDO transfers.

use ecrt_sys::{
    EC_REQUEST_BUSY, EC_REQUEST_ERROR, EC_REQUEST_SUCCESS, EC_REQUEST_UNUSED, EC_WC_COMPLETE,
    EC_WC_INCOMPLETE, EC_WC_ZERO, ec_domain_state_t, ec_domain_t, ec_master_t, ec_reg_request_t,
    ec_request_state_t, ec_sdo_request_t, ec_slave_config_t,
};
use libc::size_t;

use super::boundary::{
    Call, CallResult, Target, bytes, data_or_null, guarded, handle_or_null, on_config, on_domain,
    on_master, on_reg_request, on_request, store, with_reg_request, with_request,
};
use crate::ecrt::domain::Queued;
use crate::ecrt::sdo_transfer::{RequestId, SdoObject};
use crate::ecrt::shared::State;
use crate::ecrt::slaves::{RegRequest, RequestProgress, SdoRequest};
use crate::fault::LibraryCall;

pub unsafe extern "C" fn domain_size(domain: *const ec_domain_t) -> size_t {
    let size = guarded(|| {
        let call = on_domain(domain)?;
        call.with(|state| Ok(state.master.configs.domain(call.object)?.size))
    });
    size.unwrap_or(size_t::MAX)
}

pub unsafe extern "C" fn domain_data(domain: *mut ec_domain_t) -> *mut u8 {
    data_or_null(|| {
        let call = on_domain(domain)?;
        call.with(|state| {
            let memory = &state.master.configs.domain(call.object)?.memory;
            Ok(memory.as_ref().ok_or(libc::EAGAIN)?.as_ptr())
        })
    })
}

/// Queues a datagram of the clocks. Only the monitor's needs no reference clock.
fn queue_clock(call: &Call<()>, item: Queued, target: Option<u64>) -> CallResult {
    call.driving(|state| {
        if item != Queued::ClockMonitor && state.master.reference_clock().is_none() {
            return Err(libc::ENXIO);
        }
        let clocks = &mut state.master.clocks;
        if clocks.are_set() {
            if item == Queued::ReferenceClock {
                clocks.aim_reference(target);
            }
            state.master.enqueue(item);
        }
        Ok(())
    })
}

pub unsafe extern "C" fn master_sync_monitor_process(master: *mut ec_master_t) -> u32 {
    let difference = guarded(|| {
        on_master(master)?.driving(|state| Ok(state.master.clocks.take_monitor_value()))
    });
    difference.unwrap_or(u32::MAX)
}

functions! {
    two_forms domain_process(domain: *mut ec_domain_t) {
        let call = on_domain(domain)?;
        call.driving(|State { world, master, .. }| {
            world.fault_schedule_mut().library_call(LibraryCall::DomainProcess)?;
            master.configs.domain(call.object)?.process();
            Ok(())
        })
    }

    two_forms domain_queue(domain: *mut ec_domain_t) {
        let call = on_domain(domain)?;
        call.driving(|State { world, master, .. }| {
            world.fault_schedule_mut().library_call(LibraryCall::DomainQueue)?;
            for datagram in 0..master.configs.domain(call.object)?.datagrams.len() {
                master.enqueue(Queued::Domain { domain: call.object, datagram });
            }
            Ok(())
        })
    }

    two_forms domain_state(domain: *const ec_domain_t, state: *mut ec_domain_state_t) {
        let call = on_domain(domain)?;
        let value = call.with(|State { world, master, .. }| {
            world.fault_schedule_mut().library_call(LibraryCall::DomainState)?;
            let domain = master.configs.domain(call.object)?;
            let working_counter = domain.working_counter;
            let wc_state = match working_counter {
                0 => EC_WC_ZERO,
                counter if counter == domain.expected => EC_WC_COMPLETE,
                _ => EC_WC_INCOMPLETE,
            };
            Ok(ec_domain_state_t { working_counter, wc_state, redundancy_active: 0 })
        })?;
        // SAFETY: the caller passes a pointer for the state, or null.
        unsafe { store(state, value) }
    }

    two_forms master_send(master: *mut ec_master_t) {
        on_master(master)?.driving(|State { world, master, .. }| {
            world.fault_schedule_mut().library_call(LibraryCall::Send)?;
            master.send(world);
            Ok(())
        })
    }

    two_forms master_receive(master: *mut ec_master_t) {
        on_master(master)?.driving(|State { world, master, .. }| {
            world.fault_schedule_mut().library_call(LibraryCall::Receive)?;
            master.receive(world.now_ns());
            Ok(())
        })
    }

    two_forms master_application_time(master: *mut ec_master_t, time_ns: u64) {
        on_master(master)?.driving(|State { world, master, .. }| {
            master.clocks.application_time(time_ns, world.now_ns());
            Ok(())
        })
    }

    without_error master_sync_reference_clock(master: *mut ec_master_t) {
        queue_clock(&on_master(master)?, Queued::ReferenceClock, None)
    }

    one_form master_sync_reference_clock_to(master: *mut ec_master_t, time_ns: u64) {
        queue_clock(&on_master(master)?, Queued::ReferenceClock, Some(time_ns))
    }

    without_error master_sync_slave_clocks(master: *mut ec_master_t) {
        queue_clock(&on_master(master)?, Queued::SlaveClocks, None)
    }

    // like the real function, it writes each failure to stderr
    one_form master_reference_clock_time(master: *mut ec_master_t, time_ns: *mut u32) {
        let value = on_master(master)?.driving(|state| {
            let has_reference = state.master.reference_clock().is_some();
            state.master.clocks.take_reference_value(has_reference)
        })?;
        // SAFETY: the caller passes a pointer for the time, or null.
        unsafe { store(time_ns, value) }
    }

    without_error master_sync_monitor_queue(master: *mut ec_master_t) {
        queue_clock(&on_master(master)?, Queued::ClockMonitor, None)
    }
}

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

/// Transfers. The abort code is set only with `EIO`.
///
/// # Safety
/// `abort_code` is null or valid for writing.
unsafe fn transfer(
    master: *mut ec_master_t,
    position: u16,
    object: SdoObject,
    download: Option<Vec<u8>>,
    abort_code: *mut u32,
) -> CallResult<Vec<u8>> {
    on_master(master)?.shared.transfer(position, object, download).map_err(|failure| {
        if failure.errno == libc::EIO {
            // SAFETY: the caller's promise. Without a pointer the code is dropped.
            let _ = unsafe { store(abort_code, failure.abort_code) };
        }
        failure.errno
    })
}

functions! {
    one_form master_sdo_download(
        master: *mut ec_master_t, position: u16, index: u16, subindex: u8, data: *const u8,
        size: size_t, abort_code: *mut u32
    ) {
        let object = SdoObject::entry(index, subindex);
        // SAFETY: the caller passes `size` bytes and a pointer for the code, each or null.
        unsafe {
            let data = bytes(data, size)?;
            transfer(master, position, object, Some(data), abort_code).map(drop)
        }
    }

    /// Writes an object by Complete Access, which the gateway rejects.
    one_form master_sdo_download_complete(
        master: *mut ec_master_t, position: u16, index: u16, data: *const u8, size: size_t,
        abort_code: *mut u32
    ) {
        // SAFETY: the caller passes `size` bytes and a pointer for the code, each or null.
        unsafe {
            let data = bytes(data, size)?;
            transfer(master, position, SdoObject::whole(index), Some(data), abort_code).map(drop)
        }
    }

    one_form master_sdo_upload(
        master: *mut ec_master_t, position: u16, index: u16, subindex: u8, target: *mut u8,
        target_size: size_t, result_size: *mut size_t, abort_code: *mut u32
    ) {
        let object = SdoObject::entry(index, subindex);
        // SAFETY: the caller passes a pointer for the code, or null.
        let data = unsafe { transfer(master, position, object, None, abort_code)? };
        if data.len() > target_size {
            return Err(libc::EOVERFLOW);
        }
        if target.is_null() {
            return Err(libc::EFAULT);
        }
        // SAFETY: the caller passes a pointer to `target_size` bytes, and there are no more.
        unsafe { target.copy_from_nonoverlapping(data.as_ptr(), data.len()) };
        // SAFETY: the caller passes a pointer for the size, or null.
        unsafe { store(result_size, data.len()) }
    }
}
