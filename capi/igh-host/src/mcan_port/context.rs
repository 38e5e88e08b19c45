//! Life of a Port

use std::ffi::c_int;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, pointers};
use ecan_c_export::export;
use ecan_host::Phase;
use ecan_mcan_port::Port;

use super::config::igh_mcan_port_config_t;
use crate::adapter::config::ecan_igh_config_t;
use crate::adapter::context::ecan_igh_context_t;
use crate::bus::Bus;
use crate::encoded::EncodedCall as _;
use crate::entry::Context;
use crate::errors::{self, OrCode as _};
use crate::handle::{self, Entered, Kind};
use crate::port_config::configured;

/// CAN and CAN FD through the gateways of one master. Belongs to the thread of the cycle; do not
/// move or copy it. Ends with its ecan_igh_context_t at the latest.
#[repr(C)]
#[derive(Debug)]
pub struct igh_mcan_port_t {
    /// Not for the application.
    pub opaque: [u64; 4],
}

impl Context for igh_mcan_port_t {
    type Object = Bus;
    const KIND: Kind = Kind::Port;
    type Layer<'a> = &'a mut Port;

    #[inline(always)]
    fn is_current(bus: &Entered<Bus>) -> bool {
        bus.names_port()
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
///          ECAN_ERR_SDO, ECAN_ERR_MASTER. An error does not change the master.
#[export(call, bus bus, of igh)]
pub fn igh_mcan_port_init(
    port: *mut igh_mcan_port_t,
    igh: *mut ecan_igh_context_t,
    config: *const igh_mcan_port_config_t,
) {
    pointers!(call, out(port), encoded(config));
    // The existing Port may be this one; it stays.
    // SAFETY: `out` was promised that the pointer is valid.
    unsafe { bus.need_no_port(call, port.as_ptr().cast())? };
    if bus.need_adapter(call)?.phase() != Phase::Configured {
        let text =
            format_args!("the bus is active already: call igh_mcan_port_init before activation");
        return Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text));
    }
    // SAFETY: as above.
    unsafe { handle::clear(port.as_ptr().cast()) };
    let applied = bus.applied;
    let serial = bus.add_port(call, |adapter| {
        let config = configured(&config, adapter.slave_count());
        if applied.is_some_and(|applied| applied != config) {
            let text = format_args!(
                "the configuration is not the one that igh_mcan_port_apply_config was given"
            );
            let code = call.fail(ecan_result_t::ECAN_ERR_CONFIG, text);
            return Err((code, Box::new(adapter)));
        }
        Port::on(adapter, config).map_err(|(adapter, error)| (errors::note(call, &error), adapter))
    })?;
    // SAFETY: as above.
    unsafe { bus.add_port_context(port.as_ptr().cast(), serial) };
}

/// Configures the gateways again, to change N or channels at run time (manual 14.2). Then wait for
/// OP again. Frames that were not delivered are lost, statistics restart, axes on the Port end.
///
/// @param igh_config  Of the Adapter; the Port's part of it is `config`.
/// @param config      Of the gateways.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  As ecan_igh_init(); a faulty configuration changes nothing. After any other error
///          reconfigure again. ECAN_ERR_ATTACHED.
#[must_use]
#[export(call, bus bus)]
pub fn igh_mcan_port_reconfigure(
    port: *mut igh_mcan_port_t,
    igh_config: *const ecan_igh_config_t,
    config: *const igh_mcan_port_config_t,
) {
    pointers!(call, encoded(igh_config), encoded(config));
    let (igh_config, config) =
        (igh_config.configured(), configured(&config, igh_config.slave_count));
    let reconfigured = bus.need_port(call)?.reconfigure((igh_config, config));
    if reconfigured.as_ref().err().is_none_or(errors::port_has_changed) {
        bus.forget_configuration();
    }
    reconfigured.or_code(call)
}

/// Returns 1 if every gateway is ready: in OP and verified.
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
#[export(_, layer port, or 0)]
pub fn igh_mcan_port_is_ready(port: *mut igh_mcan_port_t) -> c_int {
    Ok(port.is_ready().into())
}

/// Closes the Port; the master stays active. Axes on the Port end: those that may move are stopped before,
/// as by igh_cia402_context_deinit().
///
/// @usage   not rt, the cycle's thread, any time
/// @return  ECAN_OK, also for a Port that is closed already or was never opened.
///          Also for a copy of it, which ends nothing. ECAN_ERR_AXES names the axes that may still
///          move; the Port is closed nevertheless.
#[export(call, end mut bus)]
pub fn igh_mcan_port_deinit(port: *mut igh_mcan_port_t) {
    let stopped = bus.stop_axes();
    bus.remove_port();
    stopped.or_code(call)
}
