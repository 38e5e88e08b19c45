//! Configuration of the master

use std::ffi::{c_char, c_int, c_void};
use std::time::Duration;

use ecan_c_boundary::pointers;
use ecan_c_export::export;

use super::config::{ECAN_IGH_MAX_SLAVES, Text, ecan_igh_config_t};
use crate::callback::StopAddress;
use crate::encoded::EncodedCall as _;

/// Selects the EtherCAT master library.
///
/// Without this call the environment variable ECAN_ECRT selects it, and without that variable it is
/// the installed libethercat.so.1. The SDK never falls back to the simulator automatically.
///
/// @param setting  "" for libethercat.so.1; the path of a library; "sim" for the built-in
///                 simulator with the scenario that was suggested; "sim:echo", "sim:drives" or
///                 "sim:FILE.toml" for a scenario. NULL removes the choice. Is copied.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT, ECAN_ERR_BUFFER. ecan_igh_init() reports a library that
///          cannot be loaded.
#[export(call, config config)]
pub fn ecan_igh_config_set_ecrt(config: *mut ecan_igh_config_t, setting: *const c_char) {
    config.ecrt = if setting.is_null() {
        None
    } else {
        pointers!(call, text(setting));
        Some(Text::new(call, "setting", setting)?)
    };
}

/// Selects the EtherCAT master.
///
/// @param index  0 for /dev/EtherCAT0, the default.
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_set_master_index(config: *mut ecan_igh_config_t, index: u32) {
    config.adapter.master_index = index;
}

/// Sets the number of ECAN-Lite slaves; slave i is at position i unless that is changed.
///
/// @param count  1 to ECAN_IGH_MAX_SLAVES.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn ecan_igh_config_set_slave_count(config: *mut ecan_igh_config_t, count: usize) {
    if !(1..=ECAN_IGH_MAX_SLAVES).contains(&count) {
        let text = format_args!("{count} is out of range; allowed: 1 to {ECAN_IGH_MAX_SLAVES}");
        return Err(call.argument("count", text));
    }
    config.slave_count = count;
}

/// Gets the number of slaves, after igh_mcan_port_load_config() for example.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn ecan_igh_config_get_slave_count(config: *const ecan_igh_config_t, count: *mut usize) {
    pointers!(call, encoded(config), out(count));
    count.set(config.slave_count);
}

/// Sets the period of the application's cycle.
///
/// @param cycle_us  Microseconds, 1 to 4294967. Typical are 100 to 100000; must be shorter than the
///                  watchdog: ecan_igh_config_set_watchdog_us().
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn ecan_igh_config_set_cycle_us(config: *mut ecan_igh_config_t, cycle_us: u32) {
    const MOST: u32 = u32::MAX / 1000;
    if !(1..=MOST).contains(&cycle_us) {
        let text = format_args!("{cycle_us} is out of range; allowed: 1 to {MOST}");
        return Err(call.argument("cycle_us", text));
    }
    config.adapter.cycle = Duration::from_micros(cycle_us.into());
}

/// Gets the period of the application's cycle.
///
/// @param cycle_ns  Nanoseconds: a file may have fractions of a microsecond.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn ecan_igh_config_get_cycle_ns(config: *const ecan_igh_config_t, cycle_ns: *mut u32) {
    pointers!(call, encoded(config), out(cycle_ns));
    cycle_ns.set(config.adapter.cycle_ns());
}

/// States that the installed master carries more than 1486 bytes of process data per sync manager.
/// Without it N is at most 11 (ECAN_PDO_MAX_PLAIN_MULTIPLIER).
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_allow_large_pdos(config: *mut ecan_igh_config_t, allow: c_int) {
    config.adapter.allow_large_pdos = allow != 0;
}

/// Sets the time in which the slaves must respond in PREOP, in milliseconds; 10000 by default.
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_set_preop_timeout_ms(config: *mut ecan_igh_config_t, timeout_ms: u32) {
    config.adapter.preop_timeout = Duration::from_millis(timeout_ms.into());
}

/// Sets the process data watchdog of the gateways: a gateway that receives no outputs for this time
/// changes from OP to SAFEOP (AL status code 0x001B) and sends no more frames of the application.
///
/// @param watchdog_us  A multiple of 100 from 100 to 6553500, 100000 by default. Must be longer
///                     than two cycles, or a single lost frame ends operation.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK. The value is checked with the others by ecan_igh_check_config() and
///          ecan_igh_init().
#[export(_, config config)]
pub fn ecan_igh_config_set_watchdog_us(config: *mut ecan_igh_config_t, watchdog_us: u32) {
    config.adapter.watchdog = Duration::from_micros(watchdog_us.into());
}

/// Sets a function that ecan_igh_init() and ecan_igh_attach() call many times per second while they
/// wait, for a master that is still scanning the bus for example: if it returns other than 0, they end
/// with ECAN_ERR_STOPPED. After them the waiting calls of all layers call it, as after
/// ecan_igh_stop_waiting_when().
///
/// @param stop  Gets `user`; NULL for none. As that of ecan_igh_stop_waiting_when(); must be valid
///              as long as a context of this configuration exists.
/// @param user  Is passed to it, in the thread that waits.
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_stop_waiting_when(
    config: *mut ecan_igh_config_t,
    stop: Option<unsafe extern "C-unwind" fn(user: *mut c_void) -> c_int>,
    user: *mut c_void,
) {
    config.stop = stop.map(|function| StopAddress::new(function, user));
}
