//! SDO transfers that wait

use std::ffi::c_void;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, pointers};
use ecan_c_export::export;
use ecan_host::{Adapter, Diagnostics, Error, Phase};

use super::bus_state::need_slave;
use super::context::ecan_igh_context_t;
use crate::bus::Bus;
use crate::errors::OrCode as _;
use crate::handle::Entered;

/// Longest value that a transfer allocates memory for, even for a larger buffer of C.
pub(super) const MAX_VALUE_BYTES: usize = 1 << 20;

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
