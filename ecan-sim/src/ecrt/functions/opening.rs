use std::sync::Arc;

use super::{guarded, handle_or_null, on_master};
use crate::ecrt::registry::{self, Handle, Target};
use crate::ecrt::shared::Shared;
use crate::simulation::Simulation;
use ecrt_sys::{OpenMaster, ec_master_t};
use libc::c_uint;

/// `ecrt_request_master`: a master of this simulation, reserved for the caller.
///
/// Null with the thread's error number set: `ENOENT` no such master, `EBUSY` reserved by another.
pub fn request_master(simulation: &Simulation, index: c_uint) -> *mut ec_master_t {
    obtain(simulation.shared(), index, true)
}

/// `ecrt_open_master`: a read-only handle, or null as from [`request_master`].
pub fn open_master(simulation: &Simulation, index: c_uint) -> *mut ec_master_t {
    obtain(simulation.shared(), index, false)
}

pub unsafe extern "C" fn release_master(master: *mut ec_master_t) {
    let _ = guarded(|| {
        let call = on_master(master)?;
        call.shared.release_client(call.client);
        registry::forget(&call.shared, call.client, true);
        Ok(())
    });
}

functions! {
    /// Reserves the master of an opened handle.
    one_form master_reserve(master: *mut ec_master_t) {
        let call = on_master(master)?;
        call.shared.reserve(call.client)
    }

    /// Retries to bring the configured slaves to OP.
    two_forms master_reset(master: *mut ec_master_t) {
        on_master(master)?.driving(|state| {
            state.master.reset();
            Ok(())
        })
    }
}

/// Opens masters of one simulated world.
pub(super) struct SimulatedMasters {
    pub(super) shared: Arc<Shared>,
}

/// A handle of the master with this index, reserved or not.
fn obtain(shared: &Arc<Shared>, index: u32, reserved: bool) -> *mut ec_master_t {
    handle_or_null(|| {
        if index != 0 {
            return Err(libc::ENOENT);
        }
        let client = shared.open_client();
        if reserved {
            shared.reserve(client)?;
        }
        Ok(registry::insert(Handle { shared: shared.clone(), client, target: Target::Master }))
    })
}

impl OpenMaster for SimulatedMasters {
    fn request(&self, index: u32) -> *mut ec_master_t {
        obtain(&self.shared, index, true)
    }

    fn open(&self, index: u32) -> *mut ec_master_t {
        obtain(&self.shared, index, false)
    }
}
