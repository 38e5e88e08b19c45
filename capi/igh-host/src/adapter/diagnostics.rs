//! Diagnosis from another thread
//!
//! A second, unreserved handle on the master: a thread of lower priority reads states and objects
//! while the cycle runs. Each handle belongs to one thread at a time.

use std::ffi::{c_int, c_void};

use ecan_host::Diagnostics;
use ecan_mcan_host::boundary::{Call, call};
use ecan_mcan_host::common::result::ecan_result_t;

use super::bus_state::ecan_igh_master_state_t;
use super::context::ecan_igh_context_t;
use super::sdo::MAX_VALUE_BYTES;
use crate::bus;
use crate::errors::OrCode as _;
use crate::handle::{self, Entered, Kind, Pool, Pooled, Words};

/// A handle for diagnosis. Do not move or copy it. It may outlive the context.
#[repr(C)]
#[derive(Debug)]
pub struct ecan_igh_diagnostics_t {
    /// Not for the application.
    pub opaque: [u64; 4],
}

const _: () = assert!(size_of::<Words>() == size_of::<ecan_igh_diagnostics_t>());

static POOL: Pool<Diagnostics> = Pool::new();

impl Pooled for Diagnostics {
    fn pool() -> &'static Pool<Self> {
        &POOL
    }
}

/// # Safety
/// `diagnostics` is NULL or valid for reading, with any content.
unsafe fn enter(
    call: Call,
    diagnostics: *mut ecan_igh_diagnostics_t,
) -> Result<Entered<Diagnostics>, ecan_result_t> {
    // SAFETY: the caller's promise.
    unsafe { handle::enter(call, diagnostics.cast(), Kind::Diagnostics) }
}

/// Opens a handle for diagnosis.
///
/// @param diagnostics  Any content.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_ORDER for a handle that is open; ECAN_ERR_NULL,
///          ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_MASTER.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_diagnostics_open(
    diagnostics: *mut ecan_igh_diagnostics_t,
    context: *mut ecan_igh_context_t,
) -> c_int {
    call("ecan_igh_diagnostics_open", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        unsafe {
            call.out("diagnostics", diagnostics)?;
            let mut bus = bus::enter(call, context.cast())?;
            handle::init(call, diagnostics.cast(), Kind::Diagnostics, || {
                let opened = bus.need_adapter(call)?.open_diagnostics();
                opened.or_code(call)
            })
        }
    })
}

/// Reads an object of a slave and waits for it; arguments as of ecan_igh_sdo_upload().
///
/// @usage   not rt, the handle's thread, after open
/// @return  ECAN_OK; ECAN_ERR_SDO, with ecan_last_abort_code() if the slave aborted;
///          ECAN_ERR_BUFFER for a value that does not fit; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
///          ECAN_ERR_BUSY, ECAN_ERR_SLAVE, ECAN_ERR_MASTER.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_diagnostics_sdo_upload(
    diagnostics: *mut ecan_igh_diagnostics_t,
    slave: usize,
    index: u16,
    subindex: u8,
    data: *mut c_void,
    size: usize,
    length: *mut usize,
) -> c_int {
    call("ecan_igh_diagnostics_sdo_upload", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (diagnostics, mut room, out) = unsafe {
            (
                enter(call, diagnostics)?,
                call.room("data", data.cast::<u8>(), size)?,
                call.out("length", length)?,
            )
        };
        let mut value = vec![0; size.min(MAX_VALUE_BYTES)];
        let read = diagnostics.sdo_upload(slave, index, subindex, &mut value);
        let length = read.or_code(call)?;
        room.push_bytes(value.get(..length).unwrap_or_default());
        out.set(length);
        Ok(())
    })
}

/// Writes an object of a slave and waits for it; arguments as of ecan_igh_sdo_download().
///
/// @usage   not rt, the handle's thread, after open
/// @return  As ecan_igh_diagnostics_sdo_upload().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_diagnostics_sdo_download(
    diagnostics: *mut ecan_igh_diagnostics_t,
    slave: usize,
    index: u16,
    subindex: u8,
    data: *const c_void,
    size: usize,
) -> c_int {
    call("ecan_igh_diagnostics_sdo_download", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (diagnostics, data) =
            unsafe { (enter(call, diagnostics)?, call.items("data", data.cast::<u8>(), size)?) };
        let written = diagnostics.sdo_download(slave, index, subindex, data);
        written.or_code(call)
    })
}

/// Gets the state of the bus.
///
/// @usage   not rt, the handle's thread, after open
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_MASTER.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_diagnostics_master_state(
    diagnostics: *mut ecan_igh_diagnostics_t,
    state: *mut ecan_igh_master_state_t,
) -> c_int {
    call("ecan_igh_diagnostics_master_state", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (diagnostics, out) = unsafe { (enter(call, diagnostics)?, call.out("state", state)?) };
        let state = diagnostics.master_state().or_code(call)?;
        out.set(state.into());
        Ok(())
    })
}

/// Closes a handle.
///
/// @usage   not rt, the handle's thread, any time
/// @return  ECAN_OK, also for a handle that is closed already; ECAN_ERR_NULL, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_diagnostics_deinit(
    diagnostics: *mut ecan_igh_diagnostics_t,
) -> c_int {
    call("ecan_igh_diagnostics_deinit", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let handle: Option<Entered<Diagnostics>> =
            unsafe { handle::enter_to_end(call, diagnostics.cast(), Kind::Diagnostics)? };
        drop(handle.map(Entered::leave));
        Ok(())
    })
}
