//! C interface: the function table, with pointers outside and checked calls inside.
//!
//! Handles are never dereferenced (see the registry). Dereferenced are only out-parameters and
//! buffers of the caller, which are valid or null by the contract of libethercat.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::slice;
use std::sync::Arc;

use crate::ecrt::calls::{CallResult, ConfigCall, DomainCall, MasterCall};
use crate::ecrt::request_calls::{RegRequestCall, RequestCall};
use crate::scenario::EcrtVersion;
use crate::simulation::Simulation;
use ecrt_sys::{
    Ecrt, Errno, Functions, Status, ec_domain_t, ec_master_t, ec_reg_request_t, ec_sdo_request_t,
    ec_slave_config_t,
};
use libc::{c_int, c_uint, size_t};

pub(crate) fn simulated_library(simulation: &Simulation) -> Ecrt {
    let shared = simulation.shared().clone();
    let version = shared.version();
    let masters = Arc::new(opening::SimulatedMasters { shared });
    let scenario = simulation.scenario_name();
    let clock = Arc::new(simulation.clock());
    // SAFETY: every entry of the table behaves as libethercat's function of that name: it takes
    // only handles that it gave out, and touches only its own memory and what its caller passes.
    unsafe { Ecrt::simulated(table(version), masters, version.magic(), scenario, clock) }
}

fn pointer<T>(address: usize) -> *mut T {
    std::ptr::without_provenance_mut(address)
}

fn null_with<T>(errno: c_int) -> *mut T {
    Errno::new(errno).set_last();
    std::ptr::null_mut()
}

/// Runs a call. A panic becomes EIO, because it must not reach C.
fn guarded<T>(call: impl FnOnce() -> CallResult<T>) -> CallResult<T> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or(Err(libc::EIO))
}

/// Return value of a call that returns a status.
fn status(call: impl FnOnce() -> CallResult) -> c_int {
    guarded(call).map_or_else(|errno| -errno, |()| 0)
}

/// Return value of a call that returns a byte offset.
fn byte_offset(call: impl FnOnce() -> CallResult<usize>) -> c_int {
    guarded(call)
        .and_then(|byte| c_int::try_from(byte).map_err(|_| libc::EOVERFLOW))
        .unwrap_or_else(|errno| -errno)
}

fn handle_or_null<T>(call: impl FnOnce() -> CallResult<usize>) -> *mut T {
    guarded(call).map_or_else(null_with, pointer)
}

fn data_or_null(call: impl FnOnce() -> CallResult<*mut u8>) -> *mut u8 {
    guarded(call).unwrap_or_else(null_with)
}

/// Stores a result in an out-parameter.
///
/// # Safety
/// `target` is null or valid for writing.
unsafe fn store<T>(target: *mut T, value: T) -> CallResult {
    if target.is_null() {
        return Err(libc::EFAULT);
    }
    // SAFETY: not null, so valid for writing by the caller's promise.
    unsafe { target.write(value) };
    Ok(())
}

/// Returns the position of an entry: the bit in an out-parameter, the byte as result. Without the
/// out-parameter an entry inside a byte is an error.
///
/// # Safety
/// `bit_position` is null or valid for writing.
unsafe fn entry_offset(
    (byte, bit): (usize, c_uint),
    bit_position: *mut c_uint,
) -> CallResult<usize> {
    if bit_position.is_null() {
        return if bit == 0 { Ok(byte) } else { Err(libc::EFAULT) };
    }
    // SAFETY: not null, so valid for writing by the caller's promise.
    unsafe { store(bit_position, bit)? };
    Ok(byte)
}

/// Copies the caller's data.
///
/// # Safety
/// `data` is null or valid for reading `size` bytes.
unsafe fn bytes(data: *const u8, size: size_t) -> CallResult<Vec<u8>> {
    if data.is_null() || size == 0 || size > isize::MAX as usize {
        return Err(libc::EINVAL);
    }
    // SAFETY: not null, so valid for reading by the caller's promise.
    Ok(unsafe { slice::from_raw_parts(data, size) }.to_vec())
}

fn on_master(master: *const ec_master_t) -> CallResult<MasterCall> {
    MasterCall::find(master.addr())
}

fn on_config(config: *const ec_slave_config_t) -> CallResult<ConfigCall> {
    ConfigCall::find(config.addr())
}

fn on_domain(domain: *const ec_domain_t) -> CallResult<DomainCall> {
    DomainCall::find(domain.addr())
}

fn on_request(request: *const ec_sdo_request_t) -> CallResult<RequestCall> {
    RequestCall::find(request.addr())
}

fn on_reg_request(request: *const ec_reg_request_t) -> CallResult<RegRequestCall> {
    RegRequestCall::find(request.addr())
}

/// A function in both forms: 1.6 returns a status, 1.5 returns nothing.
macro_rules! two_forms {
    ($(#[$doc:meta])* $reported:ident / $silent:ident ($($argument:ident: $type:ty),*)
        $body:block) => {
        $(#[$doc])*
        pub unsafe extern "C" fn $reported($($argument: $type),*) -> ::libc::c_int {
            $crate::ecrt::functions::status(|| -> $crate::ecrt::calls::CallResult { $body })
        }
        pub(super) unsafe extern "C" fn $silent($($argument: $type),*) {
            // SAFETY: the same arguments under the same promises.
            let _ = unsafe { $reported($($argument),*) };
        }
    };
}

// after the macro that they use
mod bus;
mod configuration;
mod emergencies;
mod opening;
mod pdo_lists;
mod process_data;
mod requests;
mod sdo_transfers;
mod startup_sdos;
#[cfg(test)]
mod tests;

pub use bus::*;
pub use configuration::*;
pub use emergencies::*;
pub use opening::*;
pub use pdo_lists::*;
pub use process_data::*;
pub use requests::*;
pub use sdo_transfers::*;
pub use startup_sdos::*;

/// Function table of a simulated release.
pub fn table(version: EcrtVersion) -> Functions {
    let new = version != EcrtVersion::V1_5;
    /// The form of a function that the release has.
    macro_rules! form {
        ($reported:ident / $silent:ident) => {
            if new { Status::Reported($reported) } else { Status::Silent($silent) }
        };
    }
    Functions {
        release_master,
        master: master_info,
        master_scan_progress: new.then_some(master_scan_progress),
        master_get_slave,
        master_get_sync_manager,
        master_get_pdo,
        master_get_pdo_entry,
        master_sdo_download,
        master_sdo_upload,
        master_state: form!(master_state / master_state_silent),
        master_link_state,
        master_create_domain,
        master_slave_config,
        master_select_reference_clock,
        master_set_send_interval,
        master_activate,
        master_deactivate: form!(master_deactivate / master_deactivate_silent),
        slave_config_sync_manager,
        slave_config_watchdog: form!(slave_config_watchdog / slave_config_watchdog_silent),
        slave_config_pdo_assign_add,
        slave_config_pdo_assign_clear: form!(
            slave_config_pdo_assign_clear / slave_config_pdo_assign_clear_silent
        ),
        slave_config_pdo_mapping_add,
        slave_config_pdo_mapping_clear: form!(
            slave_config_pdo_mapping_clear / slave_config_pdo_mapping_clear_silent
        ),
        slave_config_reg_pdo_entry,
        slave_config_dc: form!(slave_config_dc / slave_config_dc_silent),
        slave_config_sdo,
        slave_config_flag: new.then_some(slave_config_flag),
        slave_config_state_timeout: new.then_some(slave_config_state_timeout),
        slave_config_state: form!(slave_config_state / slave_config_state_silent),
        slave_config_create_sdo_request,
        domain_size,
        domain_data,
        domain_process: form!(domain_process / domain_process_silent),
        domain_queue: form!(domain_queue / domain_queue_silent),
        domain_state: form!(domain_state / domain_state_silent),
        master_send: form!(master_send / master_send_silent),
        master_receive: form!(master_receive / master_receive_silent),
        master_application_time: form!(master_application_time / master_application_time_silent),
        master_sync_reference_clock: form!(
            master_sync_reference_clock / master_sync_reference_clock_silent
        ),
        master_sync_reference_clock_to: new.then_some(form!(
            master_sync_reference_clock_to / master_sync_reference_clock_to_silent
        )),
        master_sync_slave_clocks: form!(master_sync_slave_clocks / master_sync_slave_clocks_silent),
        master_reference_clock_time,
        master_sync_monitor_queue: form!(
            master_sync_monitor_queue / master_sync_monitor_queue_silent
        ),
        master_sync_monitor_process,
        sdo_request_index: form!(sdo_request_index / sdo_request_index_silent),
        sdo_request_timeout: form!(sdo_request_timeout / sdo_request_timeout_silent),
        sdo_request_data,
        sdo_request_data_size,
        sdo_request_state,
        sdo_request_write: form!(sdo_request_write / sdo_request_write_silent),
        sdo_request_read: form!(sdo_request_read / sdo_request_read_silent),
        slave_config_create_reg_request,
        reg_request_data,
        reg_request_state,
        reg_request_read: form!(reg_request_read / reg_request_read_silent),
    }
}
