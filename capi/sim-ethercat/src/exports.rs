//! The functions under libethercat's names.
//!
//! Each passes its arguments to the simulator's function, which catches panics. The arguments are
//! those of IgH's interface, with the same contract.
//!
//! # Safety
//! Out-parameters and buffers are NULL or valid, by the contract of libethercat.

use std::ffi::{c_char, c_double, c_float, c_int, c_uint, c_void};
use std::panic::catch_unwind;
use std::ptr::{null, null_mut};

use ecan_sim::{Simulation, libethercat};
use ecrt_sys::{
    Clock, EC_REQUEST_ERROR, Errno, MonotonicClock, ec_al_state_t, ec_direction_t,
    ec_domain_state_t, ec_domain_t, ec_master_info_t, ec_master_link_state_t,
    ec_master_scan_progress_t, ec_master_state_t, ec_master_t, ec_pdo_entry_info_t,
    ec_pdo_entry_reg_t, ec_pdo_info_t, ec_reg_request_t, ec_request_state_t, ec_sdo_request_t,
    ec_slave_config_state_t, ec_slave_config_t, ec_slave_info_t, ec_sync_info_t,
    ec_watchdog_mode_t,
};
use libc::{EOPNOTSUPP, c_uchar, in_addr, size_t};

use crate::world;
use crate::world::reported;

/// Exports functions of the simulator under their names in libethercat; a `status` is that of 1.6.
macro_rules! export {
    (@result status) => { c_int };
    (@result optional_status) => { c_int };
    (@result required) => { () };
    (@result $kind:ident $result:ty) => { $result };
    ($(
        $(#[$doc:meta])*
        $kind:ident $name:ident($($argument:ident: $type:ty),*) $(-> $result:ty)?;
    )*) => { $(
        #[unsafe(export_name = concat!("ecrt_", stringify!($name)))]
        pub unsafe extern "C" fn $name($($argument: $type),*) -> export!(@result $kind $($result)?) {
            // SAFETY: the same arguments under the same promises.
            let result = unsafe { ::ecan_sim::libethercat::$name($($argument),*) };
            reported(concat!("ecrt_", stringify!($name)), result)
        }
    )* };
}

ecrt_sys::for_each_function!(export);

// Functions that the SDK does not use.
export! {
    status master_reserve(master: *mut ec_master_t);
    status slave_config_pdos(
        config: *mut ec_slave_config_t, sync_count: c_uint, syncs: *const ec_sync_info_t);
    required slave_config_reg_pdo_entry_pos(
        config: *mut ec_slave_config_t, sync_index: u8, pdo_position: c_uint,
        entry_position: c_uint, domain: *mut ec_domain_t, bit_position: *mut c_uint) -> c_int;
    status slave_config_sdo8(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u8);
    status slave_config_sdo16(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u16);
    status slave_config_sdo32(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u32);
    status slave_config_complete_sdo(
        config: *mut ec_slave_config_t, index: u16, data: *const u8, size: size_t);
    status slave_config_emerg_clear(config: *mut ec_slave_config_t);
    status slave_config_emerg_overruns(config: *const ec_slave_config_t);
    status domain_reg_pdo_entry_list(
        domain: *mut ec_domain_t, entries: *const ec_pdo_entry_reg_t);
}

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

/// Returns the scenario of the process: the name of a built-in one, or the file that `ECAN_ECRT`
/// names; null with the error number set if its world cannot be opened. The text stays valid.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_sim_scenario() -> *const c_char {
    match catch_unwind(world::scenario).unwrap_or(Err(libc::EIO)) {
        Ok(text) => text.as_ptr(),
        Err(errno) => {
            Errno::new(errno).set_last();
            null()
        }
    }
}

/// Returns 1 if time passes only in `ecan_sim_sleep_until_ns` and in blocking calls, else 0.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_sim_clock_is_stepped() -> c_int {
    on_clock(|clock| (!clock.is_free_running()).into())
}

/// Returns the time of the simulated world, ns; without a world that of `CLOCK_MONOTONIC`.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_sim_now_ns() -> u64 {
    on_clock(|clock| clock.now_ns())
}

/// Sleeps until the world's clock shows `deadline_ns`, the last `spin_ns` polling.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_sim_sleep_until_ns(deadline_ns: u64, spin_ns: u64) {
    on_clock(|clock| clock.sleep_and_spin_until_ns(deadline_ns, spin_ns));
}

/// Begins the times of the scenario that count from the first time that all gateways are ready.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_sim_gateways_ready() {
    on_clock(|clock| clock.gateways_ready());
}

/// Uses the clock of the world, otherwise that of the system; catches panics.
fn on_clock<R: Default>(action: impl FnOnce(&dyn Clock) -> R + std::panic::UnwindSafe) -> R {
    let answer = catch_unwind(|| match world::clock() {
        Ok(clock) => action(&clock),
        Err(_) => action(&MonotonicClock),
    });
    answer.unwrap_or_default()
}

/// An SoE request of IgH's interface. None exists here.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Debug)]
pub struct ec_soe_request_t {
    _opaque: [u8; 0],
}

/// A VoE handler of IgH's interface. None exists here.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Debug)]
pub struct ec_voe_handler_t {
    _opaque: [u8; 0],
}

/// Return value of a function that is not supported.
trait Unsupported {
    const ANSWER: Self;
}

impl Unsupported for c_int {
    const ANSWER: Self = -EOPNOTSUPP;
}

impl Unsupported for ec_request_state_t {
    const ANSWER: Self = EC_REQUEST_ERROR;
}

impl Unsupported for size_t {
    const ANSWER: Self = 0;
}

impl<T> Unsupported for *mut T {
    const ANSWER: Self = std::ptr::null_mut();
}

/// Exports functions of SoE, VoE and EoE, which the gateway does not support: each returns an error.
macro_rules! unsupported {
    ($(
        $export:ident($($argument:ident: $type:ty),*) -> $result:ty;
    )*) => { $(
        #[unsafe(no_mangle)]
        pub extern "C" fn $export($($argument: $type),*) -> $result {
            let _ = ($($argument),*);
            Errno::new(EOPNOTSUPP).set_last();
            let result: $result = Unsupported::ANSWER;
            reported(stringify!($export), result)
        }
    )* };
}

unsupported! {
    ecrt_master_write_idn(
        master: *mut ec_master_t, position: u16, drive: u8, idn: u16, data: *const u8,
        size: size_t, error_code: *mut u16) -> c_int;
    ecrt_master_read_idn(
        master: *mut ec_master_t, position: u16, drive: u8, idn: u16, target: *mut u8,
        target_size: size_t, result_size: *mut size_t, error_code: *mut u16) -> c_int;
    ecrt_slave_config_idn(
        config: *mut ec_slave_config_t, drive: u8, idn: u16, state: ec_al_state_t,
        data: *const u8, size: size_t) -> c_int;
    ecrt_slave_config_create_soe_request(
        config: *mut ec_slave_config_t, drive: u8, idn: u16, size: size_t)
        -> *mut ec_soe_request_t;
    ecrt_soe_request_idn(request: *mut ec_soe_request_t, drive: u8, idn: u16) -> c_int;
    ecrt_soe_request_timeout(request: *mut ec_soe_request_t, timeout_ms: u32) -> c_int;
    ecrt_soe_request_data(request: *const ec_soe_request_t) -> *mut u8;
    ecrt_soe_request_data_size(request: *const ec_soe_request_t) -> size_t;
    ecrt_soe_request_state(request: *mut ec_soe_request_t) -> ec_request_state_t;
    ecrt_soe_request_write(request: *mut ec_soe_request_t) -> c_int;
    ecrt_soe_request_read(request: *mut ec_soe_request_t) -> c_int;

    ecrt_slave_config_create_voe_handler(
        config: *mut ec_slave_config_t, size: size_t) -> *mut ec_voe_handler_t;
    ecrt_voe_handler_send_header(
        handler: *mut ec_voe_handler_t, vendor_id: u32, vendor_type: u16) -> c_int;
    ecrt_voe_handler_received_header(
        handler: *const ec_voe_handler_t, vendor_id: *mut u32, vendor_type: *mut u16) -> c_int;
    ecrt_voe_handler_data(handler: *const ec_voe_handler_t) -> *mut u8;
    ecrt_voe_handler_data_size(handler: *const ec_voe_handler_t) -> size_t;
    ecrt_voe_handler_write(handler: *mut ec_voe_handler_t, size: size_t) -> c_int;
    ecrt_voe_handler_read(handler: *mut ec_voe_handler_t) -> c_int;
    ecrt_voe_handler_read_nosync(handler: *mut ec_voe_handler_t) -> c_int;
    ecrt_voe_handler_execute(handler: *mut ec_voe_handler_t) -> ec_request_state_t;

    ecrt_slave_config_eoe_mac_address(
        config: *mut ec_slave_config_t, mac_address: *const c_uchar) -> c_int;
    ecrt_slave_config_eoe_ip_address(
        config: *mut ec_slave_config_t, ip_address: in_addr) -> c_int;
    ecrt_slave_config_eoe_subnet_mask(
        config: *mut ec_slave_config_t, subnet_mask: in_addr) -> c_int;
    ecrt_slave_config_eoe_default_gateway(
        config: *mut ec_slave_config_t, gateway_address: in_addr) -> c_int;
    ecrt_slave_config_eoe_dns_address(
        config: *mut ec_slave_config_t, dns_address: in_addr) -> c_int;
    ecrt_slave_config_eoe_hostname(
        config: *mut ec_slave_config_t, name: *const c_char) -> c_int;
}

/// Reads four bytes as a value.
///
/// # Safety
/// `data` is valid for reading four bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecrt_read_real(data: *const c_void) -> c_float {
    // SAFETY: the caller's promise; an array of bytes needs no alignment.
    c_float::from_le_bytes(unsafe { data.cast::<[u8; 4]>().read() })
}

/// Reads eight bytes as a value.
///
/// # Safety
/// `data` is valid for reading eight bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecrt_read_lreal(data: *const c_void) -> c_double {
    // SAFETY: the caller's promise; an array of bytes needs no alignment.
    c_double::from_le_bytes(unsafe { data.cast::<[u8; 8]>().read() })
}

/// Writes a value as four bytes.
///
/// # Safety
/// `data` is valid for writing four bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecrt_write_real(data: *mut c_void, value: c_float) {
    // SAFETY: the caller's promise; an array of bytes needs no alignment.
    unsafe { data.cast::<[u8; 4]>().write(value.to_le_bytes()) }
}

/// Writes a value as eight bytes.
///
/// # Safety
/// `data` is valid for writing eight bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecrt_write_lreal(data: *mut c_void, value: c_double) {
    // SAFETY: the caller's promise; an array of bytes needs no alignment.
    unsafe { data.cast::<[u8; 8]>().write(value.to_le_bytes()) }
}

#[cfg(test)]
mod tests {
    use std::ptr::{null, null_mut};

    use ecrt_sys::EC_AL_STATE_PREOP;

    use super::*;

    #[test]
    fn soe_transfer_and_request_return_an_error() {
        let mut error_code = 0xEEEE;
        let mut size = 0;
        assert_eq!(
            ecrt_master_write_idn(null_mut(), 0, 0, 32, null(), 0, &mut error_code),
            -EOPNOTSUPP
        );
        assert_eq!(
            ecrt_master_read_idn(null_mut(), 0, 0, 32, null_mut(), 0, &mut size, &mut error_code),
            -EOPNOTSUPP
        );
        let request = ecrt_slave_config_create_soe_request(null_mut(), 0, 32, 4);
        assert!(request.is_null());
        assert_eq!(Errno::last(), Errno::new(EOPNOTSUPP));
        assert!(ecrt_soe_request_data(request).is_null());
        assert_eq!(ecrt_soe_request_data_size(request), 0);
        assert_eq!(ecrt_soe_request_state(request), EC_REQUEST_ERROR);
        let answers = [
            ecrt_soe_request_idn(request, 1, 33),
            ecrt_soe_request_timeout(request, 100),
            ecrt_soe_request_read(request),
            ecrt_soe_request_write(request),
        ];
        assert_eq!(answers, [-EOPNOTSUPP; 4]);
    }

    #[test]
    fn startup_idn_is_rejected() {
        let answer = ecrt_slave_config_idn(null_mut(), 0, 32, EC_AL_STATE_PREOP, null(), 0);
        assert_eq!(answer, -EOPNOTSUPP);
    }

    #[test]
    fn voe_handler_functions_return_an_error() {
        let handler = ecrt_slave_config_create_voe_handler(null_mut(), 16);
        assert!(handler.is_null());
        assert_eq!(Errno::last(), Errno::new(EOPNOTSUPP));
        assert!(ecrt_voe_handler_data(handler).is_null());
        assert_eq!(ecrt_voe_handler_data_size(handler), 0);
        assert_eq!(ecrt_voe_handler_execute(handler), EC_REQUEST_ERROR);
        let answers = [
            ecrt_voe_handler_send_header(handler, 5, 6),
            ecrt_voe_handler_received_header(handler, null_mut(), null_mut()),
            ecrt_voe_handler_write(handler, 16),
            ecrt_voe_handler_read(handler),
            ecrt_voe_handler_read_nosync(handler),
        ];
        assert_eq!(answers, [-EOPNOTSUPP; 5]);
    }

    #[test]
    fn eoe_parameters_are_rejected() {
        let address = in_addr { s_addr: 0 };
        let answers = [
            ecrt_slave_config_eoe_mac_address(null_mut(), null()),
            ecrt_slave_config_eoe_ip_address(null_mut(), address),
            ecrt_slave_config_eoe_subnet_mask(null_mut(), address),
            ecrt_slave_config_eoe_default_gateway(null_mut(), address),
            ecrt_slave_config_eoe_dns_address(null_mut(), address),
            ecrt_slave_config_eoe_hostname(null_mut(), null()),
        ];
        assert_eq!(answers, [-EOPNOTSUPP; 6]);
    }

    #[test]
    fn values_are_little_endian_at_any_offset() {
        let mut bytes = [0u8; 16];
        // SAFETY: there is room for both.
        unsafe {
            ecrt_write_real(bytes.as_mut_ptr().add(1).cast(), -2.5);
            ecrt_write_lreal(bytes.as_mut_ptr().add(7).cast(), 1.0);
        }
        assert_eq!(bytes[..7], [0, 0, 0, 0x20, 0xC0, 0, 0]);
        assert_eq!(bytes[7..], [0, 0, 0, 0, 0, 0, 0xF0, 0x3F, 0]);
        // SAFETY: as above.
        unsafe {
            assert_eq!(ecrt_read_real(bytes.as_ptr().add(1).cast()), -2.5);
            assert_eq!(ecrt_read_lreal(bytes.as_ptr().add(7).cast()), 1.0);
        }
    }
}
