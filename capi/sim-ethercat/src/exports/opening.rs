//! The first calls of every program.

use std::panic::catch_unwind;
use std::ptr::null_mut;

use ecan_sim::{Simulation, libethercat};
use ecrt_sys::{Errno, ec_master_t};
use libc::{c_int, c_uint};

use crate::report::reported;
use crate::world;

/// Major and minor version.
const VERSION_MAGIC: c_uint = 0x0106;

/// The version of the interface. A scenario of another version changes what the master does, not
/// what the functions return.
#[unsafe(no_mangle)]
pub extern "C" fn ecrt_version_magic() -> c_uint {
    VERSION_MAGIC
}

/// Reserves a master; null with the error number set if that cannot be.
#[unsafe(no_mangle)]
pub extern "C" fn ecrt_request_master(master_index: c_uint) -> *mut ec_master_t {
    let master = in_world(|world| libethercat::request_master(world, master_index));
    reported("ecrt_request_master", master)
}

/// Opens a master for looking; null with the error number set if that cannot be.
#[unsafe(no_mangle)]
pub extern "C" fn ecrt_open_master(master_index: c_uint) -> *mut ec_master_t {
    let master = in_world(|world| libethercat::open_master(world, master_index));
    reported("ecrt_open_master", master)
}

/// Opens the world if need be. A panic meanwhile ends here.
fn in_world(
    call: impl FnOnce(&Simulation) -> *mut ec_master_t + std::panic::UnwindSafe,
) -> *mut ec_master_t {
    let answer = catch_unwind(|| world::simulation().map(|world| call(&world)));
    match answer.unwrap_or(Err(libc::EIO)) {
        Ok(master) => master,
        Err(errno) => {
            Errno::new(errno).set_last();
            null_mut()
        }
    }
}

export! {
    silent ecrt_release_master(master: *mut ec_master_t) = release_master;
    reported ecrt_master_reserve(master: *mut ec_master_t) -> c_int = master_reserve;
    silent ecrt_master_reset(master: *mut ec_master_t) -> c_int = master_reset;
}
