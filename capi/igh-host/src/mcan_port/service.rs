//! Service for other programs
//!
//! Programs such as `ecan monitor`, `ecan dump` and `ecan diag`, and clients in any language, take part
//! in the bus while the application runs its cycle: they connect to a Unix socket (docs/SERVICE.md). The
//! cycle copies its images to bounded memory and waits for no client.

use std::ffi::{OsStr, c_char};
use std::os::unix::ffi::OsStrExt as _;
use std::path::PathBuf;

use ecan_c_boundary::pointers;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_export::export;
use ecan_service::server::{Control, ServePort as _, ServiceConfig};

use super::context::igh_mcan_port_t;
use crate::errors::OrCode as _;

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
