//! Life of a Port

use std::ffi::c_int;

use ecan_host::Phase;
use ecan_mcan_host::boundary::{Call, Sealed, call};
use ecan_mcan_host::common::result::ecan_result_t;
use ecan_mcan_port::Port;

use super::config::igh_mcan_port_config_t;
use crate::adapter::config::ecan_igh_config_t;
use crate::adapter::context::ecan_igh_context_t;
use crate::bus::{self, Bus};
use crate::entry::{Context, enter};
use crate::errors::{self, OrCode as _};
use crate::handle::{self, Entered, Kind, Words};
use crate::port_config::configured;

/// CAN and CAN FD through the gateways of one master. Belongs to the thread of the cycle; do not
/// move or copy it. Ends with its ecan_igh_context_t at the latest.
#[repr(C)]
#[derive(Debug)]
pub struct igh_mcan_port_t {
    /// Not for the application.
    pub opaque: [u64; 4],
}

const _: () = assert!(size_of::<Words>() == size_of::<igh_mcan_port_t>());

impl Context for igh_mcan_port_t {
    type Layer<'a> = &'a mut Port;

    #[inline(always)]
    unsafe fn enter(call: Call, context: *const Self) -> Result<Entered<Bus>, ecan_result_t> {
        // SAFETY: the caller's promise.
        unsafe { bus::enter_port(call, context.cast()) }
    }

    #[inline]
    fn layer(call: Call, bus: &mut Entered<Bus>) -> Result<&mut Port, ecan_result_t> {
        bus.need_port(call)
    }
}

/// Opens a Port on a master that is not active yet. ecan_igh_wait_op_timeout() then waits until the
/// gateways are ready.
///
/// @param port    Any content; the manual's fragments leave it uninitialised.
/// @param igh     The master. Must not move while the Port is used.
/// @param config  The configuration that was applied with igh_mcan_port_apply_config(). Is copied.
///
/// @usage   not rt, the cycle's thread, after ecan_igh_init and before the bus is active
/// @return  ECAN_OK; ECAN_ERR_CONFIG with every fault, or for another configuration than the one
///          that was applied; ECAN_ERR_ORDER if there is a Port already or the bus is active;
///          ECAN_ERR_SDO, ECAN_ERR_MASTER, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
///          ECAN_ERR_BUSY. An error does not change the master.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_init(
    port: *mut igh_mcan_port_t,
    igh: *mut ecan_igh_context_t,
    config: *const igh_mcan_port_config_t,
) -> c_int {
    call("igh_mcan_port_init", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, config) = unsafe {
            call.out("port", port)?;
            (bus::enter(call, igh.cast())?, Sealed::read(call, "config", config)?)
        };
        // The existing Port may be this one; it stays.
        bus.need_no_port(call)?;
        if bus.need_adapter(call)?.phase() != Phase::Configured {
            let text = format_args!(
                "the bus is active already: call igh_mcan_port_init before activation"
            );
            return Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text));
        }
        // SAFETY: as above.
        unsafe { handle::clear(port.cast()) };
        let applied = bus.applied;
        let serial = bus.add_port(call, |adapter| {
            let config = configured(config, adapter.slave_count());
            if applied.is_some_and(|applied| applied != config) {
                let text = format_args!(
                    "the configuration is not the one that igh_mcan_port_apply_config was given"
                );
                let code = call.fail(ecan_result_t::ECAN_ERR_CONFIG, text);
                return Err((code, Box::new(adapter)));
            }
            Port::on(adapter, config)
                .map_err(|(adapter, error)| (errors::note(call, &error), adapter))
        })?;
        // SAFETY: as above.
        unsafe { bus.add_context(port.cast(), Kind::Port, serial) };
        Ok(())
    })
}

/// Configures the gateways again, to change N or channels at run time (manual 14.2). Then wait for
/// OP again. Frames that were not delivered are lost, statistics restart, axes on the Port end.
///
/// @param igh_config  Of the Adapter; the Port's part of it is `config`.
/// @param config      Of the gateways.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  As ecan_igh_init(); a faulty configuration changes nothing. After any other error
///          reconfigure again. ECAN_ERR_ATTACHED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_reconfigure(
    port: *mut igh_mcan_port_t,
    igh_config: *const ecan_igh_config_t,
    config: *const igh_mcan_port_config_t,
) -> c_int {
    call("igh_mcan_port_reconfigure", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, adapter, config) = unsafe {
            (
                bus::enter_port(call, port.cast())?,
                Sealed::read(call, "config", igh_config)?,
                Sealed::read(call, "config", config)?,
            )
        };
        let (adapter, config) = (adapter.configured(), configured(config, adapter.slave_count));
        let reconfigured = bus.need_port(call)?.reconfigure((adapter, config));
        if reconfigured.as_ref().err().is_none_or(errors::port_has_changed) {
            bus.forget_configuration();
        }
        reconfigured.or_code(call)
    })
}

/// Returns 1 if every gateway is ready: in OP and verified.
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY. Compare with 1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_is_ready(port: *mut igh_mcan_port_t) -> c_int {
    enter!(igh_mcan_port_is_ready, port).get(|_, port| Ok(port.is_ready().into()))
}

/// Closes the Port; the master stays active. Axes on the Port end.
///
/// @usage   not rt, the cycle's thread, any time
/// @return  ECAN_OK, also for a Port that is closed already or was never opened; ECAN_ERR_NULL,
///          ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_deinit(port: *mut igh_mcan_port_t) -> c_int {
    call("igh_mcan_port_deinit", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        if let Some(mut bus) = unsafe { bus::enter_port_to_end(call, port.cast())? } {
            bus.remove_port();
        }
        Ok(())
    })
}
