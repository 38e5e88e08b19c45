//! The function table, and the functions that open masters and return the states of master and slaves.

use std::sync::Arc;

use ecrt_sys::{
    EC_DIR_INPUT, EC_DIR_INVALID, EC_DIR_OUTPUT, EC_PORT_MII, EC_PORT_NOT_IMPLEMENTED,
    EC_WD_DISABLE, EC_WD_ENABLE, Ecrt, Functions, OpenMaster, Status, ec_master_info_t,
    ec_master_link_state_t, ec_master_scan_progress_t, ec_master_state_t, ec_master_t,
    ec_pdo_entry_info_t, ec_pdo_info_t, ec_slave_info_t, ec_sync_info_t,
};
use libc::{c_char, c_uint};

use super::boundary;
use super::boundary::{CallResult, Handle, Target, guarded, handle_or_null, on_master, store};
#[allow(clippy::wildcard_imports)]
use super::configuration::*;
#[allow(clippy::wildcard_imports)]
use super::process_data::*;
use crate::ecrt::domain::{Pdo, direction_of};
use crate::ecrt::master::object_count;
use crate::ecrt::shared::{Shared, State};
use crate::ecrt::slaves::SlaveView;
use crate::scenario::EcrtVersion;
use crate::simulation::Simulation;
use crate::world::ProcessDirection;

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

fn slave_info(slave: &SlaveView, position: u16, count: usize) -> ec_slave_info_t {
    let description = &slave.description;
    let mut value = ec_slave_info_t {
        position,
        vendor_id: description.vendor_id,
        product_code: description.product_code,
        revision_number: description.revision,
        serial_number: description.serial,
        alias: description.alias,
        al_state: slave.current,
        error_flag: u8::from(slave.error_flag),
        sync_count: description.sync_managers,
        sdo_count: if slave.has_dictionary { object_count() } else { 0 },
        ..Default::default()
    };
    // the last byte remains 0
    let room = value.name.len() - 1;
    for (to, from) in value.name.iter_mut().take(room).zip(description.name.bytes()) {
        *to = from as c_char;
    }
    let next = position.saturating_add(1);
    for (number, port) in value.ports.iter_mut().enumerate() {
        port.desc = if number < 2 { EC_PORT_MII } else { EC_PORT_NOT_IMPLEMENTED };
        let linked = number == 0 || (number == 1 && usize::from(next) < count);
        port.link.link_up = u8::from(linked);
        port.link.signal_detected = u8::from(linked);
        port.link.loop_closed = u8::from(!linked);
        port.next_slave = match number {
            0 if position > 0 => position - 1,
            1 if linked => next,
            _ => u16::MAX,
        };
    }
    value
}

/// Evaluates the PDOs that a sync manager assigns by default, and stores the result.
///
/// # Safety
/// `target` is null or valid for writing.
unsafe fn store_pdo_info<T>(
    master: *mut ec_master_t,
    position: u16,
    sync: u8,
    target: *mut T,
    info: impl FnOnce(&[Pdo]) -> Option<T>,
) -> CallResult {
    let value = on_master(master)?.with(|state| {
        let slave = state.master.slaves.get(usize::from(position));
        let has_sync = |slave: &&SlaveView| sync < slave.description.sync_managers;
        let pdos = slave.filter(has_sync).and_then(|slave| slave.assigned.get(usize::from(sync)));
        pdos.and_then(|pdos| info(pdos)).ok_or(libc::EINVAL)
    })?;
    // SAFETY: the caller's promise.
    unsafe { store(target, value) }
}

/// Number of responding slaves, their AL states, and whether the link is up.
fn link_state(master: *const ec_master_t) -> CallResult<(c_uint, c_uint, c_uint)> {
    on_master(master)?.with(|State { world, master, .. }| {
        let (responding, al_states) = master.scan.responses();
        Ok((responding, al_states.into(), world.link_is_up().into()))
    })
}

functions! {
    one_form master(master: *mut ec_master_t, info: *mut ec_master_info_t) {
        let value = on_master(master)?.with(|State { world, master, .. }| {
            let mut value = ec_master_info_t {
                slave_count: master.slaves.len() as c_uint,
                scan_busy: u8::from(master.scan.is_running()),
                app_time: master.clocks.app_time(),
                ..Default::default()
            };
            value.set_link_up(c_uint::from(world.link_is_up()));
            Ok(value)
        })?;
        // SAFETY: the caller passes a pointer for the information, or null.
        unsafe { store(info, value) }
    }

    one_form master_scan_progress(
        master: *mut ec_master_t, progress: *mut ec_master_scan_progress_t
    ) {
        let value = on_master(master)?.with(|state| {
            let scanned = state.master.slaves.len() as c_uint;
            let total = state.master.scan.slave_count().map_or(scanned, |count| count as c_uint);
            Ok(ec_master_scan_progress_t { slave_count: total, scan_index: scanned })
        })?;
        // SAFETY: the caller passes a pointer for the progress, or null.
        unsafe { store(progress, value) }
    }

    one_form master_get_slave(
        master: *mut ec_master_t, position: u16, info: *mut ec_slave_info_t
    ) {
        let value = on_master(master)?.with(|state| {
            let slaves = &state.master.slaves;
            let slave = slaves.get(usize::from(position)).ok_or(libc::EINVAL)?;
            Ok(slave_info(slave, position, slaves.len()))
        })?;
        // SAFETY: the caller passes a pointer for the information, or null.
        unsafe { store(info, value) }
    }

    one_form master_get_sync_manager(
        master: *mut ec_master_t, position: u16, sync_index: u8, sync: *mut ec_sync_info_t
    ) {
        let info = |pdos: &[Pdo]| Some(ec_sync_info_t {
            index: sync_index,
            dir: match direction_of(sync_index) {
                Some(ProcessDirection::Output) => EC_DIR_OUTPUT,
                Some(ProcessDirection::Input) => EC_DIR_INPUT,
                None => EC_DIR_INVALID,
            },
            n_pdos: pdos.len() as c_uint,
            pdos: std::ptr::null_mut(),
            watchdog_mode: if sync_index == 2 { EC_WD_ENABLE } else { EC_WD_DISABLE },
        });
        // SAFETY: the caller passes a pointer for the information, or null.
        unsafe { store_pdo_info(master, position, sync_index, sync, info) }
    }

    one_form master_get_pdo(
        master: *mut ec_master_t, position: u16, sync_index: u8, pdo_position: u16,
        pdo: *mut ec_pdo_info_t
    ) {
        let info = |pdos: &[Pdo]| {
            let found = pdos.get(usize::from(pdo_position))?;
            let n_entries = found.entries.len() as c_uint;
            Some(ec_pdo_info_t { index: found.index, n_entries, entries: std::ptr::null_mut() })
        };
        // SAFETY: the caller passes a pointer for the information, or null.
        unsafe { store_pdo_info(master, position, sync_index, pdo, info) }
    }

    one_form master_get_pdo_entry(
        master: *mut ec_master_t, position: u16, sync_index: u8, pdo_position: u16,
        entry_position: u16, entry: *mut ec_pdo_entry_info_t
    ) {
        let info = |pdos: &[Pdo]| {
            let pdo = pdos.get(usize::from(pdo_position))?;
            let found = pdo.entries.get(usize::from(entry_position))?;
            let (index, subindex) = (found.index, found.subindex);
            Some(ec_pdo_entry_info_t { index, subindex, bit_length: found.bits })
        };
        // SAFETY: the caller passes a pointer for the information, or null.
        unsafe { store_pdo_info(master, position, sync_index, entry, info) }
    }

    two_forms master_state(master: *const ec_master_t, state: *mut ec_master_state_t) {
        let (slaves_responding, al_states, link_up) = link_state(master)?;
        let mut value = ec_master_state_t { slaves_responding, ..Default::default() };
        value.set_al_states(al_states);
        value.set_link_up(link_up);
        // SAFETY: the caller passes a pointer for the state, or null.
        unsafe { store(state, value) }
    }

    // only one link exists
    one_form master_link_state(
        master: *const ec_master_t, device: c_uint, state: *mut ec_master_link_state_t
    ) {
        if device != 0 {
            return Err(libc::EINVAL);
        }
        let (slaves_responding, al_states, link_up) = link_state(master)?;
        let mut value = ec_master_link_state_t { slaves_responding, ..Default::default() };
        value.set_al_states(al_states);
        value.set_link_up(link_up);
        // SAFETY: the caller passes a pointer for the state, or null.
        unsafe { store(state, value) }
    }
}
