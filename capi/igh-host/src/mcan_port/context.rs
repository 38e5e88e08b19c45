//! Context of a Port: life, service for other programs.

use std::ffi::{OsStr, c_char, c_int};
use std::os::unix::ffi::OsStrExt as _;
use std::path::PathBuf;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, OutPointer, pointers};
use ecan_c_export::export;
use ecan_host::Phase;
use ecan_mcan_port::{Port, PortConfig};
use ecan_service::server::{Control, ServePort as _, ServiceConfig};

use super::config::igh_mcan_port_config_t;
use super::config_file::load;
use crate::adapter::config::{IghConfig, configured_port, ecan_igh_config_t, extended_port};
use crate::adapter::context::{ecan_igh_context_t, init_with};
use crate::bus::Bus;
use crate::encoded::EncodedCall as _;
use crate::errors::OrCode as _;
use crate::guard::Access;
use crate::handle::{Context, Entered, Kind};
use crate::{errors, handle};

// Section: Life of a Port

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

/// Opens what a configuration file describes: loads the library that the environment variable ECAN_ECRT
/// selects, opens the master and the gateways, and waits until frames can be sent. Blocks for seconds. A plain
/// "sim" has the gateways, nodes and axes of the file. ecan_igh_deinit() closes everything.
///
/// @param igh   Any content.
/// @param port  Any content.
/// @param path  As of igh_mcan_port_load_config().
///
/// @usage   not rt, the cycle's thread, any time
/// @return  As igh_mcan_port_load_config(), ecan_igh_init(), igh_mcan_port_init() and
///          ecan_igh_wait_op_timeout(). After an error there is nothing to deinit.
#[must_use]
#[export(call)]
pub fn ecan_open(igh: *mut ecan_igh_context_t, port: *mut igh_mcan_port_t, path: *const c_char) {
    pointers!(call, out(igh), out(port), c_str(path));
    let file = load(path).map_err(|error| errors::note(call, &error))?;
    let options = ecan_lite::config::load_ecrt_options(OsStr::from_bytes(path.to_bytes()))
        .map_err(|error| errors::note(call, &error))?;
    let config = IghConfig::new().with(&file.adapter, extended_port(&file.port));
    init_with(call, &igh, &config, options)?;
    // SAFETY: `out` was promised that the pointer is valid.
    let mut bus = unsafe { handle::enter_context(call, igh.as_ptr(), Access::Long)? };
    let opened = add(call, &mut bus, &port, &file.port)
        .and_then(|()| bus.need_port(call)?.wait_ready().or_code(call));
    match opened {
        Ok(()) => bus.watch_port(),
        Err(_) => drop(bus.leave()),
    }
    opened
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
    add(call, bus, &port, &config)
}

/// Opens a Port on the Adapter of a bus.
pub(super) fn add(
    call: Call,
    bus: &mut Entered<Bus>,
    port: &OutPointer<igh_mcan_port_t>,
    config: &PortConfig,
) -> Result<(), ecan_result_t> {
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
        let config = configured_port(config, adapter.slave_count());
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
    Ok(())
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
        (igh_config.adapter_config(), configured_port(&config, igh_config.slave_count));
    let reconfigured = bus.need_port(call)?.reconfigure((igh_config, config));
    if reconfigured.as_ref().err().is_none_or(errors::port_has_changed) {
        bus.forget_configuration();
    }
    bus.watch_port();
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

// Section: Service for other programs
//
// Programs such as `ecan monitor`, `ecan dump` and `ecan diag`, and clients in any language, take part
// in the bus while the application runs its cycle: they connect to a Unix socket (docs/SERVICE.md). The
// cycle copies its images to bounded memory and waits for no client.

/// Clients of the same user, and of root, may control the bus: send frames, download SDOs, send NMT
/// commands. Without a flag every client only reads.
pub const IGH_MCAN_SERVE_CONTROL: u32 = 1;
/// Every client that may open the socket may control the bus.
pub const IGH_MCAN_SERVE_CONTROL_ALL: u32 = 2;

const FLAGS: u32 = IGH_MCAN_SERVE_CONTROL | IGH_MCAN_SERVE_CONTROL_ALL;

/// Starts a service for other programs on threads of its own; it replaces an earlier one. It ends with
/// igh_mcan_port_end_service() or with the Port, and continues after a reconfiguration.
///
/// @param path   Path of the socket, with the permissions 0660. Its directory is created, not those
///               above. /run/ecan/master0.sock is where `ecan` looks for the service of master 0.
/// @param flags  0, IGH_MCAN_SERVE_CONTROL or IGH_MCAN_SERVE_CONTROL_ALL.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_FILE if another service uses the socket or it cannot be created;
///          ECAN_ERR_ARGUMENT for an unknown flag. After an error there is no service.
#[must_use]
#[export(call, bus bus)]
pub fn igh_mcan_port_serve(port: *mut igh_mcan_port_t, path: *const c_char, flags: u32) {
    pointers!(call, c_str(path));
    if flags & !FLAGS != 0 {
        let text = format_args!("flags 0x{flags:X} are out of range; allowed: 0 to 0x{FLAGS:X}");
        return Err(call.fail(ecan_result_t::ECAN_ERR_ARGUMENT, text));
    }
    let control = match flags {
        0 => Control::Nobody,
        IGH_MCAN_SERVE_CONTROL => Control::Owner,
        _ => Control::Everyone,
    };
    let path = PathBuf::from(OsStr::from_bytes(path.to_bytes()));
    let config = ServiceConfig::new(path).with_control(control);
    // Before the new one: it may have the same socket.
    bus.service = None;
    let service = bus.need_port(call)?.serve(config).or_code(call)?;
    bus.service = Some(service);
    Ok(())
}

/// Ends the service: closes its connections and removes its socket.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, also without a service.
#[export(_, bus bus)]
pub fn igh_mcan_port_end_service(port: *mut igh_mcan_port_t) {
    bus.service = None;
    Ok(())
}
