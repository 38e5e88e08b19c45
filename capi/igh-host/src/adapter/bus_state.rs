//! State of the bus and its slaves

use std::ffi::{c_char, c_int};

use ecan_host::MasterState;
use ecan_mcan_host::boundary::{Call, call, getter, put_text};
use ecan_mcan_host::common::result::ecan_result_t;

use super::config::no_slave;
use super::context::ecan_igh_context_t;
use crate::bus;
use crate::errors;

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

/// How far the master brought a slave. It lags behind the working counter by seconds.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ecan_igh_slave_state_t {
    /// 1 where the slave was found.
    pub online: u8,
    /// 1 where it reached OP with this configuration.
    pub operational: u8,
    /// An ecan_igh_al_state_t.
    pub al_state: u8,
    /// Not used.
    pub reserved: u8,
}

/// What the master sees of the bus.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ecan_igh_master_state_t {
    /// Slaves that answer.
    pub slaves_responding: u32,
    /// AL states that occur: bit 0 INIT, 1 PREOP, 2 SAFEOP, 3 OP.
    pub al_states: u8,
    /// 1 where a link is up.
    pub link_up: u8,
    /// Not used.
    pub reserved: [u8; 2],
}

impl From<MasterState> for ecan_igh_master_state_t {
    fn from(state: MasterState) -> Self {
        Self {
            slaves_responding: state.slaves_responding,
            al_states: state.al_states,
            link_up: state.link_up.into(),
            reserved: [0; 2],
        }
    }
}

/// What is known of a slave.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ecan_igh_slave_info_t {
    /// Serial number of the gateway (0xF000:07 and :08).
    pub serial_number: u64,
    /// Vendor id as found on the bus.
    pub vendor_id: u32,
    /// Product code as found on the bus.
    pub product_code: u32,
    /// Revision as found on the bus.
    pub revision: u32,
    /// Ring position.
    pub position: u16,
    /// Station alias; 0 for none.
    pub alias: u16,
    /// An ecan_igh_al_state_t, with bit 4 (0x10) for an error.
    pub al_state: u8,
    /// 1 where the master met an error with the slave and holds it where it is.
    pub error_flag: u8,
    /// Not used.
    pub reserved: [u8; 6],
    /// Name, cut to its place.
    pub name: [c_char; 64],
}

/// Refuses a slave that is not configured.
pub(crate) fn need_slave(
    call: Call,
    adapter: &ecan_host::Adapter,
    slave: usize,
) -> Result<(), ecan_result_t> {
    let count = adapter.slave_count();
    if slave < count { Ok(()) } else { Err(no_slave(call, slave, count)) }
}

/// Number of configured slaves.
///
/// @usage   rt, the cycle's thread, after init
/// @return  The number; 0 where there is no context.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_slave_count(context: *mut ecan_igh_context_t) -> usize {
    getter(
        "ecan_igh_slave_count",
        |_| 0,
        |call| {
            // SAFETY: the pointer is C's, valid or NULL as the header demands.
            let mut bus = unsafe { bus::enter(call, context.cast())? };
            Ok(bus.need_adapter(call)?.slave_count())
        },
    )
}

/// Whether all slaves are in OP and the last exchange was complete.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  1 or 0; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_MASTER.
///          Compare with 1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_is_operational(context: *mut ecan_igh_context_t) -> c_int {
    getter(
        "ecan_igh_is_operational",
        |error| error.code(),
        |call| {
            // SAFETY: the pointer is C's, valid or NULL as the header demands.
            let mut bus = unsafe { bus::enter(call, context.cast())? };
            let all = bus.need_adapter(call)?.all_operational();
            all.map(c_int::from).map_err(|error| errors::cycle(call, &error))
        },
    )
}

/// How far the master brought a slave.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE,
///          ECAN_ERR_MASTER.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_get_slave_state(
    context: *mut ecan_igh_context_t,
    slave: usize,
    state: *mut ecan_igh_slave_state_t,
) -> c_int {
    call("ecan_igh_get_slave_state", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter(call, context.cast())?, call.out("state", state)?) };
        let adapter = bus.need_adapter(call)?;
        need_slave(call, adapter, slave)?;
        let state = adapter.slave_state(slave).map_err(|error| errors::cycle(call, &error))?;
        out.set(ecan_igh_slave_state_t {
            online: state.online.into(),
            operational: state.operational.into(),
            al_state: state.al_state,
            reserved: 0,
        });
        Ok(())
    })
}

/// What the master sees of the bus.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_MASTER.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_get_master_state(
    context: *mut ecan_igh_context_t,
    state: *mut ecan_igh_master_state_t,
) -> c_int {
    call("ecan_igh_get_master_state", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter(call, context.cast())?, call.out("state", state)?) };
        let state = bus.need_adapter(call)?.diagnostics().master_state();
        let state = state.map_err(|error| errors::adapter(call, &error))?;
        out.set(state.into());
        Ok(())
    })
}

/// What is known of a slave.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE,
///          ECAN_ERR_MASTER.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_get_slave_info(
    context: *mut ecan_igh_context_t,
    slave: usize,
    info: *mut ecan_igh_slave_info_t,
) -> c_int {
    call("ecan_igh_get_slave_info", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter(call, context.cast())?, call.out("info", info)?) };
        let adapter = bus.need_adapter(call)?;
        need_slave(call, adapter, slave)?;
        let found = adapter
            .serial_number(slave)
            .and_then(|serial| Ok((serial, adapter.diagnostics().slave_info(slave)?)));
        let (serial_number, found) = found.map_err(|error| errors::adapter(call, &error))?;
        let mut value = ecan_igh_slave_info_t {
            serial_number,
            vendor_id: found.vendor_id,
            product_code: found.product_code,
            revision: found.revision_number,
            position: found.position,
            alias: found.alias,
            al_state: found.al_state,
            error_flag: found.error_flag.into(),
            reserved: [0; 6],
            name: [0; 64],
        };
        // SAFETY: the room is the array.
        let mut name = unsafe { call.room("name", value.name.as_mut_ptr(), value.name.len())? };
        put_text(&mut name, &found.name);
        out.set(value);
        Ok(())
    })
}
