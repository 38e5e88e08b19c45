//! The function table, and the functions that open masters.

use std::sync::Arc;

use ecrt_sys::{Ecrt, Functions, OpenMaster, Status, ec_master_t};
use libc::c_uint;

use super::boundary;
use super::boundary::{Handle, Target, guarded, handle_or_null, on_master};
use crate::ecrt::shared::Shared;
use crate::scenario::EcrtVersion;
use crate::simulation::Simulation;

#[allow(clippy::wildcard_imports)]
use super::{bus::*, configuration::*, process_data::*};

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
        boundary::forget(&call.shared, call.client, true);
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
        Ok(boundary::insert(Handle { shared: shared.clone(), client, target: Target::Master }))
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

pub(crate) fn simulated_library(simulation: &Simulation) -> Ecrt {
    let shared = simulation.shared().clone();
    let version = shared.version;
    let masters = Arc::new(SimulatedMasters { shared });
    let scenario = simulation.scenario_name();
    let clock = Arc::new(simulation.clock());
    // SAFETY: every entry of the table behaves as libethercat's function of that name: it takes
    // only handles that it gave out, and touches only its own memory and what its caller passes.
    unsafe { Ecrt::simulated(table(version), masters, version.magic(), scenario, clock) }
}

/// Function table of a simulated release.
pub fn table(version: EcrtVersion) -> Functions {
    let is_1_6 = version != EcrtVersion::V1_5;
    macro_rules! entry {
        (required $name:ident) => {
            $name
        };
        (optional $name:ident) => {
            is_1_6.then_some($name)
        };
        (status $name:ident) => {
            if is_1_6 { Status::Reported($name) } else { Status::Silent($name::silent) }
        };
        (optional_status $name:ident) => {
            is_1_6.then_some(Status::Reported($name))
        };
    }
    macro_rules! table {
        ($( $(#[$doc:meta])* $kind:ident $name:ident($($arguments:tt)*) $(-> $result:ty)?; )*) => {
            Functions { $( $name: entry!($kind $name), )* }
        };
    }
    ecrt_sys::for_each_function!(table)
}
