//! State of bus and slaves, also from a thread without the cycle.

use std::ffi::{c_char, c_int, c_void};

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror, pointers, put_text};
use ecan_c_export::export;
use ecan_host::{Diagnostics, MasterState, SlaveConfigState};

use super::context::ecan_igh_context_t;
use crate::errors::{OrCode as _, no_slave};
use crate::handle;
use crate::handle::{Context, Entered, Kind, Pool, Pooled};

/// Longest value that a transfer allocates memory for, even for a larger buffer of C.
pub(super) const MAX_VALUE_BYTES: usize = 1 << 20;

// Section: State of the bus and its slaves

/// AL state of a slave.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ecan_igh_al_state_t {
    /// INIT.
    ECAN_IGH_AL_INIT = 1,
    /// PREOP.
    ECAN_IGH_AL_PREOP = 2,
    /// SAFEOP.
    ECAN_IGH_AL_SAFEOP = 4,
    /// OP.
    ECAN_IGH_AL_OP = 8,
}

mirror! {
    /// State of a slave as the master reports it. It lags the working counter by seconds.
    pub struct ecan_igh_slave_state_t from state: SlaveConfigState {
        /// 1 if the slave was found.
        online: u8,
        /// 1 if the slave reached OP with this configuration.
        operational: u8,
        /// An ecan_igh_al_state_t.
        al_state: u8,
        /// Zero; for fields of later versions.
        reserved: [u8; 13] = [0; 13],
    }
}

mirror! {
    /// State of the bus as the master reports it.
    pub struct ecan_igh_master_state_t from state: MasterState {
        /// Slaves that respond.
        slaves_responding: u32,
        /// AL states that occur: bit 0 INIT, 1 PREOP, 2 SAFEOP, 3 OP.
        al_states: u8,
        /// 1 if a link is up.
        link_up: u8,
        /// Zero; for fields of later versions.
        reserved: [u8; 26] = [0; 26],
    }
}

/// Identity and state of a slave.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ecan_igh_slave_info_t {
    /// Serial number of the gateway (0xF000:07 and :08).
    pub serial_number: u64,
    /// Vendor ID as found on the bus.
    pub vendor_id: u32,
    /// Product code as found on the bus.
    pub product_code: u32,
    /// Revision as found on the bus.
    pub revision: u32,
    /// Position on the bus.
    pub position: u16,
    /// Station alias; 0 for none.
    pub alias: u16,
    /// An ecan_igh_al_state_t, with bit 4 (0x10) for an error.
    pub al_state: u8,
    /// 1 if the master found an error with the slave and keeps it in its state.
    pub error_flag: u8,
    /// Zero.
    pub padding: [u8; 6],
    /// Name; cut if it is too long.
    pub name: [c_char; 64],
    /// Zero; for fields of later versions.
    pub reserved: [u64; 4],
}

pub(crate) fn need_slave(
    call: Call,
    adapter: &ecan_host::Adapter,
    slave: usize,
) -> Result<(), ecan_result_t> {
    let count = adapter.slave_count();
    if slave < count { Ok(()) } else { Err(no_slave(call, slave, count)) }
}

/// Returns the number of configured slaves.
///
/// @usage   rt, the cycle's thread, after init
/// @return  The number; 0 if there is no context.
#[export(_, layer adapter, or 0)]
pub fn ecan_igh_slave_count(context: *mut ecan_igh_context_t) -> usize {
    Ok(adapter.slave_count())
}

/// Returns 1 if all slaves are in OP and the last exchange was complete.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  1 or 0; 0 after an error, ECAN_ERR_MASTER for example, which ecan_last_error_code() gives.
#[export(call, layer adapter, or 0)]
pub fn ecan_igh_is_operational(context: *mut ecan_igh_context_t) -> c_int {
    let all = adapter.all_operational().or_code(call)?;
    Ok(all.into())
}

/// Gets the state of a slave.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_MASTER.
#[export(call, layer adapter, into state)]
pub fn ecan_igh_get_slave_state(
    context: *mut ecan_igh_context_t,
    slave: usize,
    state: *mut ecan_igh_slave_state_t,
) {
    need_slave(call, adapter, slave)?;
    let state = adapter.slave_state(slave).or_code(call)?;
    Ok(state.into())
}

/// Gets the state of the bus.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_MASTER.
#[export(call, layer adapter, into state)]
pub fn ecan_igh_get_master_state(
    context: *mut ecan_igh_context_t,
    state: *mut ecan_igh_master_state_t,
) {
    let state = adapter.diagnostics().master_state();
    Ok(state.or_code(call)?.into())
}

/// Gets identity and state of a slave.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_MASTER.
#[export(call, layer adapter, into info)]
pub fn ecan_igh_get_slave_info(
    context: *mut ecan_igh_context_t,
    slave: usize,
    info: *mut ecan_igh_slave_info_t,
) {
    need_slave(call, adapter, slave)?;
    let found = adapter
        .slave(slave)
        .and_then(|unit| Ok((unit.serial_number(), adapter.diagnostics().slave_info(slave)?)));
    let (serial_number, found) = found.or_code(call)?;
    let mut value = ecan_igh_slave_info_t {
        serial_number,
        vendor_id: found.vendor_id,
        product_code: found.product_code,
        revision: found.revision_number,
        position: found.position,
        alias: found.alias,
        al_state: found.al_state,
        error_flag: found.error_flag.into(),
        padding: [0; 6],
        reserved: [0; 4],
        name: [0; 64],
    };
    // SAFETY: the room is the array.
    let mut name = unsafe { call.room("name", value.name.as_mut_ptr(), value.name.len())? };
    put_text(&mut name, &found.name);
    Ok(value)
}

// Section: Diagnosis from another thread
//
// A second, unreserved handle on the master: a thread of lower priority reads states and objects
// while the cycle runs. Each handle belongs to one thread at a time.

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
