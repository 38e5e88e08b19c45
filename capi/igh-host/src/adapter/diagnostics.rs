//! Diagnosis from another thread
//!
//! A second, unreserved handle on the master: a thread of lower priority reads states and objects
//! while the cycle runs. Each handle belongs to one thread at a time.

use std::ffi::c_void;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, pointers};
use ecan_c_export::export;
use ecan_host::Diagnostics;

use super::bus_state::ecan_igh_master_state_t;
use super::context::ecan_igh_context_t;
use super::sdo::MAX_VALUE_BYTES;
use crate::entry::Context;
use crate::errors::OrCode as _;
use crate::handle::{self, Entered, Kind, Pool, Pooled};

/// A handle for diagnosis. Do not move or copy it. It may outlive the context.
#[repr(C)]
#[derive(Debug)]
pub struct ecan_igh_diagnostics_t {
    /// Not for the application.
    pub opaque: [u64; 4],
}

static POOL: Pool<Diagnostics> = Pool::new();

impl Pooled for Diagnostics {
    fn pool() -> &'static Pool<Self> {
        &POOL
    }
}

impl Context for ecan_igh_diagnostics_t {
    type Object = Diagnostics;
    const KIND: Kind = Kind::Diagnostics;
    type Layer<'a> = &'a mut Diagnostics;

    fn layer(
        _: Call,
        object: &mut Entered<Diagnostics>,
    ) -> Result<&mut Diagnostics, ecan_result_t> {
        Ok(object)
    }
}

/// Opens a handle for diagnosis.
///
/// @param diagnostics  Any content.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_ORDER for a handle that is open; ECAN_ERR_MASTER.
#[must_use]
#[export(call, layer adapter, of context)]
pub fn ecan_igh_diagnostics_open(
    diagnostics: *mut ecan_igh_diagnostics_t,
    context: *mut ecan_igh_context_t,
) {
    pointers!(call, out(diagnostics));
    // SAFETY: `out` was promised that the pointer is valid for writing.
    unsafe {
        handle::init(call, diagnostics.as_ptr().cast(), Kind::Diagnostics, || {
            adapter.open_diagnostics().or_code(call)
        })
    }
}

/// Reads an object of a slave and waits for it; arguments as of ecan_igh_sdo_upload().
///
/// @usage   not rt, the handle's thread, after open
/// @return  ECAN_OK; ECAN_ERR_SDO, with ecan_last_abort_code() if the slave aborted;
///          ECAN_ERR_BUFFER for a value that does not fit; ECAN_ERR_SLAVE, ECAN_ERR_MASTER.
#[must_use]
#[export(call, layer diagnostics)]
pub fn ecan_igh_diagnostics_sdo_upload(
    diagnostics: *mut ecan_igh_diagnostics_t,
    slave: usize,
    index: u16,
    subindex: u8,
    data: *mut c_void,
    size: usize,
    length: *mut usize,
) {
    pointers!(call, byte_room(data, size), out(length));
    let mut value = vec![0; size.min(MAX_VALUE_BYTES)];
    let read = diagnostics.sdo_upload(slave, index, subindex, &mut value).or_code(call)?;
    data.push_bytes(value.get(..read).unwrap_or_default());
    length.set(read);
}

/// Writes an object of a slave and waits for it; arguments as of ecan_igh_sdo_download().
///
/// @usage   not rt, the handle's thread, after open
/// @return  As ecan_igh_diagnostics_sdo_upload().
#[must_use]
#[export(call, layer diagnostics)]
pub fn ecan_igh_diagnostics_sdo_download(
    diagnostics: *mut ecan_igh_diagnostics_t,
    slave: usize,
    index: u16,
    subindex: u8,
    data: *const c_void,
    size: usize,
) {
    pointers!(call, bytes(data, size));
    diagnostics.sdo_download(slave, index, subindex, data).or_code(call)
}

/// Gets the state of the bus.
///
/// @usage   not rt, the handle's thread, after open
/// @return  ECAN_OK, ECAN_ERR_MASTER.
#[export(call, layer diagnostics, into state)]
pub fn ecan_igh_diagnostics_master_state(
    diagnostics: *mut ecan_igh_diagnostics_t,
    state: *mut ecan_igh_master_state_t,
) {
    Ok(diagnostics.master_state().or_code(call)?.into())
}

/// Closes a handle.
///
/// @usage   not rt, the handle's thread, any time
/// @return  ECAN_OK, also for a handle that is closed already.
///          Also for a copy of it, which ends nothing.
#[export(_, end object)]
pub fn ecan_igh_diagnostics_deinit(diagnostics: *mut ecan_igh_diagnostics_t) {
    drop(object.leave());
}
