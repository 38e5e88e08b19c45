//! Version, and opening a master.

use std::panic::catch_unwind;
use std::ptr::null_mut;

use ecan_sim::{Simulation, libethercat};
use ecrt_sys::{Errno, ec_master_t};
use libc::c_uint;

use crate::report::reported;
use crate::world;

/// Major and minor version.
const VERSION_MAGIC: c_uint = 0x0106;

/// Returns the version of the interface. The version of a scenario changes the behaviour of the
/// master, not the return types.
#[unsafe(no_mangle)]
pub extern "C" fn ecrt_version_magic() -> c_uint {
    VERSION_MAGIC
}

/// Reserves a master; null with the error number set after a failure.
#[unsafe(no_mangle)]
pub extern "C" fn ecrt_request_master(master_index: c_uint) -> *mut ec_master_t {
    let master = in_world(|world| libethercat::request_master(world, master_index));
    reported("ecrt_request_master", master)
}

/// Opens a master for reading; null with the error number set after a failure.
#[unsafe(no_mangle)]
pub extern "C" fn ecrt_open_master(master_index: c_uint) -> *mut ec_master_t {
    let master = in_world(|world| libethercat::open_master(world, master_index));
    reported("ecrt_open_master", master)
}

/// Runs a call in the world, which the first call opens; catches panics.
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
