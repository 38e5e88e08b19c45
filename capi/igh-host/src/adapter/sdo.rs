//! SDO transfers that wait, and requests in the cycle.

use std::ffi::{c_int, c_void};

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_host::{Adapter, CycleError, Diagnostics, Error, Phase, RequestState};

use super::bus_state::{MAX_VALUE_BYTES, need_slave};
use super::context::ecan_igh_context_t;
use crate::bus::{Bus, Request};
use crate::errors::OrCode as _;
use crate::handle::Entered;

// Section: SDO transfers that wait

/// Runs a transfer; on an active bus in parallel with the cycle.
fn diagnose<R: Send>(
    call: Call,
    bus: &mut Entered<Bus>,
    slave: usize,
    work: impl FnOnce(&Diagnostics) -> Result<R, Error> + Send,
) -> Result<R, ecan_result_t> {
    let adapter = bus.need_adapter(call)?;
    need_slave(call, adapter, slave)?;
    if adapter.phase() == Phase::Active {
        bus.run_to_end(call)?;
    }
    let done = match bus.port_mut() {
        Some(port) => port.diagnose(work).or_code(call)?,
        None => {
            let adapter = bus.need_adapter(call)?;
            let cycle = |adapter: &mut Adapter| {
                let received = adapter.receive();
                adapter.send().and(received)
            };
            adapter.diagnose(cycle, work).or_code(call)?
        }
    };
    done.or_code(call)
}

/// Reads an object of a slave and waits for it. On an active bus the call runs the cycle and drops
/// received frames. In the cycle use ecan_igh_sdo_request_read().
///
/// @param data    Gets the value, little endian.
/// @param size    Bytes of the buffer.
/// @param length  Gets the bytes of the value.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_SDO, with ecan_last_abort_code() if the slave aborted;
///          ECAN_ERR_BUFFER for a value that does not fit; ECAN_ERR_SLAVE, ECAN_ERR_MASTER;
///          ECAN_ERR_ATTACHED on an active bus of another owner: use
///          ecan_igh_diagnostics_sdo_upload() in another thread.
#[must_use]
#[export(call, bus bus)]
pub fn ecan_igh_sdo_upload(
    context: *mut ecan_igh_context_t,
    slave: usize,
    index: u16,
    subindex: u8,
    data: *mut c_void,
    size: usize,
    length: *mut usize,
) {
    pointers!(call, byte_room(data, size), out(length));
    let value = diagnose(call, bus, slave, |diagnostics| {
        let mut value = vec![0; size.min(MAX_VALUE_BYTES)];
        let length = diagnostics.sdo_upload(slave, index, subindex, &mut value)?;
        value.truncate(length);
        Ok(value)
    })?;
    data.push_bytes(&value);
    length.set(value.len());
}

/// Writes an object of a slave and waits for it; as ecan_igh_sdo_upload().
///
/// @param data  The value, little endian.
/// @param size  Its bytes.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  As ecan_igh_sdo_upload().
#[must_use]
#[export(call, bus bus)]
pub fn ecan_igh_sdo_download(
    context: *mut ecan_igh_context_t,
    slave: usize,
    index: u16,
    subindex: u8,
    data: *const c_void,
    size: usize,
) {
    pointers!(call, bytes(data, size));
    diagnose(call, bus, slave, |diagnostics| diagnostics.sdo_download(slave, index, subindex, data))
}

// Section: SDO requests in the cycle
//
// Created before the bus is active, used in the cycle: start a transfer, read its state in later
// cycles, take the value. A transfer takes some tens of cycles.

mirror! {
    /// State of an SDO request.
    pub enum ecan_igh_request_state_t from RequestState {
        /// The request was not used yet.
        ECAN_IGH_REQUEST_UNUSED = 0 => RequestState::Unused,
        /// In progress.
        ECAN_IGH_REQUEST_RUNNING = 1 => RequestState::Busy,
        /// Done.
        ECAN_IGH_REQUEST_SUCCESS = 2 => RequestState::Success,
        /// Aborted by the slave, or timed out; the kernel log says which.
        ECAN_IGH_REQUEST_ERROR = 3 => RequestState::Error,
    }
}

fn find(call: Call, bus: &Entered<Bus>, request: usize) -> Result<Request, ecan_result_t> {
    let count = bus.requests.len();
    bus.requests.get(request).copied().ok_or_else(|| {
        call.argument("request", format_args!("{request} is none of the {count} requests"))
    })
}

fn state(
    call: Call,
    bus: &mut Entered<Bus>,
    request: Request,
) -> Result<RequestState, ecan_result_t> {
    let state = bus.need_adapter(call)?.requests().sdo_state(request.id);
    state.or_code(call)
}

/// Starts a transfer of a request that is not in progress.
fn start(
    call: Call,
    bus: &mut Entered<Bus>,
    request: Request,
    transfer: impl FnOnce(&mut Adapter) -> Result<(), CycleError>,
) -> Result<(), ecan_result_t> {
    if state(call, bus, request)? == RequestState::Busy {
        let text = format_args!("a transfer of the request is in progress");
        return Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text));
    }
    transfer(bus.need_adapter(call)?).or_code(call)
}

/// Creates an SDO request. A reconfiguration ends all requests.
///
/// @param size     Bytes of the values to write, or most bytes of the values to read.
/// @param request  Gets the number of the request.
///
/// @usage   not rt, the cycle's thread, after init and before the bus is active
/// @return  ECAN_OK; ECAN_ERR_ORDER on an active bus; ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT,
///          ECAN_ERR_MASTER.
#[must_use]
#[export(call, bus bus)]
pub fn ecan_igh_create_sdo_request(
    context: *mut ecan_igh_context_t,
    slave: usize,
    size: usize,
    request: *mut usize,
) {
    pointers!(call, out(request));
    let adapter = bus.need_adapter(call)?;
    need_slave(call, adapter, slave)?;
    if !(1..=65_536).contains(&size) {
        let text = format_args!("{size} is out of range; allowed: 1 to 65536");
        return Err(call.argument("size", text));
    }
    let created = adapter.requests().create_sdo(slave, size);
    let id = created.or_code(call)?;
    bus.requests.push(Request { id, size });
    request.set(bus.requests.len() - 1);
}

/// Sets the timeout for transfers of the request.
///
/// @param timeout_ms  Milliseconds; 0 for the master's own.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER.
#[export(call, bus bus)]
pub fn ecan_igh_sdo_request_timeout(
    context: *mut ecan_igh_context_t,
    request: usize,
    timeout_ms: u32,
) {
    let request = find(call, bus, request)?;
    let set = bus.need_adapter(call)?.requests().sdo_timeout(request.id, timeout_ms);
    set.or_code(call)
}

/// Starts reading an object.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_ORDER while a transfer of the request is in progress;
///          ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER.
#[must_use]
#[export(call, bus bus)]
pub fn ecan_igh_sdo_request_read(
    context: *mut ecan_igh_context_t,
    request: usize,
    index: u16,
    subindex: u8,
) {
    let request = find(call, bus, request)?;
    start(call, bus, request, |adapter| adapter.requests().sdo_read(request.id, index, subindex))
}

/// Starts writing an object. The EtherCAT library takes the length of a value from what the request
/// holds, so use one request for each size, and another one for reading.
///
/// @param data  The value, little endian. Is copied.
/// @param size  Its bytes: the size with which the request was created, or the size of the value
///              that it read last.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  As ecan_igh_sdo_request_read(); ECAN_ERR_BUFFER for another number of bytes.
#[must_use]
#[export(call, bus bus)]
pub fn ecan_igh_sdo_request_write(
    context: *mut ecan_igh_context_t,
    request: usize,
    index: u16,
    subindex: u8,
    data: *const c_void,
    size: usize,
) {
    pointers!(call, bytes(data, size));
    let request = find(call, bus, request)?;
    if size > request.size {
        let text = format_args!("{size} bytes do not fit a request of {}", request.size);
        return Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text));
    }
    start(call, bus, request, |adapter| {
        adapter.requests().sdo_write(request.id, index, subindex, data)
    })
}

/// Returns the state of a request.
///
/// @usage   rt, the cycle's thread, after init
/// @return  An ecan_igh_request_state_t; ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER.
#[export(call, bus bus)]
pub fn ecan_igh_sdo_request_state(context: *mut ecan_igh_context_t, request: usize) -> c_int {
    let request = find(call, bus, request)?;
    Ok(ecan_igh_request_state_t::from(state(call, bus, request)?) as c_int)
}

/// Takes the value of a finished read.
///
/// @param data    Gets the value, little endian.
/// @param size    Bytes of the buffer.
/// @param length  Gets the bytes of the value.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_BUFFER with what fits stored; ECAN_ERR_ORDER if the state is not
///          success; ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER.
#[must_use]
#[export(call, bus bus)]
pub fn ecan_igh_sdo_request_data(
    context: *mut ecan_igh_context_t,
    request: usize,
    data: *mut c_void,
    size: usize,
    length: *mut usize,
) {
    pointers!(call, byte_room(data, size), out(length));
    let request = find(call, bus, request)?;
    if state(call, bus, request)? != RequestState::Success {
        let text = format_args!("the request has no value");
        return Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text));
    }
    let value = bus.need_adapter(call)?.requests().sdo_data(request.id);
    length.set(value.len());
    if data.push_bytes(value) {
        return Ok(());
    }
    let text = format_args!("the value has {} bytes, {size} fit", value.len());
    Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text))
}
