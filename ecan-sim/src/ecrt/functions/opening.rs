//! Opening and releasing a master.

use std::sync::Arc;

use super::{guarded, null_with, on_master, pointer, status};
use crate::ecrt::registry::{self, Handle, Target};
use crate::ecrt::shared::Shared;
use crate::simulation::Simulation;
use ecrt_sys::{OpenMaster, ec_master_t};
use libc::{c_int, c_uint};

/// `ecrt_request_master`: a master of this simulation, reserved for the caller.
///
/// Null with the thread's error number set: `ENOENT` no such master, `EBUSY` reserved by another.
pub fn request_master(simulation: &Simulation, index: c_uint) -> *mut ec_master_t {
    SimulatedMasters::of(simulation).request(index)
}

/// `ecrt_open_master`: a read-only handle, or null as from [`request_master`].
pub fn open_master(simulation: &Simulation, index: c_uint) -> *mut ec_master_t {
    SimulatedMasters::of(simulation).open(index)
}

/// `ecrt_master_reserve`: reserves the master of an opened handle.
pub unsafe extern "C" fn master_reserve(master: *mut ec_master_t) -> c_int {
    status(|| on_master(master)?.reserve())
}

/// `ecrt_release_master`: releases a master; all handles made from it become invalid.
pub unsafe extern "C" fn release_master(master: *mut ec_master_t) {
    let _ = guarded(|| {
        on_master(master)?.release();
        Ok(())
    });
}

/// `ecrt_master_reset`: retries to bring the configured slaves to OP.
pub unsafe extern "C" fn master_reset(master: *mut ec_master_t) -> c_int {
    status(|| on_master(master)?.reset())
}

/// Opens masters of one simulated world.
pub(super) struct SimulatedMasters {
    pub(super) shared: Arc<Shared>,
}

impl SimulatedMasters {
    fn of(simulation: &Simulation) -> Self {
        Self { shared: simulation.shared().clone() }
    }

    /// A handle of the master with this index, reserved or not.
    fn obtain(&self, index: u32, reserved: bool) -> *mut ec_master_t {
        let client = guarded(|| {
            if index != 0 {
                return Err(libc::ENOENT);
            }
            let client = self.shared.open_client();
            if reserved {
                self.shared.reserve(client)?;
            }
            Ok(client)
        });
        client.map_or_else(null_with, |client| {
            let shared = self.shared.clone();
            pointer(registry::insert(Handle { shared, client, target: Target::Master }))
        })
    }
}

impl OpenMaster for SimulatedMasters {
    fn request(&self, index: u32) -> *mut ec_master_t {
        self.obtain(index, true)
    }

    fn open(&self, index: u32) -> *mut ec_master_t {
        self.obtain(index, false)
    }
}
