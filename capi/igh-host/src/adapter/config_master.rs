//! Configuration of the master

use std::ffi::{c_char, c_int};

use ecan_mcan_host::boundary::call;

use super::config::{AdapterPlain, ECAN_IGH_MAX_SLAVES, Text, ecan_igh_config_t};

/// Chooses the EtherCAT master library.
///
/// Without this call the environment variable ECAN_ECRT decides, and without that the installed
/// libethercat.so.1. The SDK never falls back to the simulator by itself.
///
/// @param setting  "" for libethercat.so.1; the path of a library; "sim" for the built-in
///                 simulator with the scenario that was suggested; "sim:echo", "sim:drives" or
///                 "sim:FILE.toml" for a scenario. NULL undoes the choice. Is copied.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ARGUMENT, ECAN_ERR_BUFFER.
///          Whether there is such a library is told by ecan_igh_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_ecrt(
    config: *mut ecan_igh_config_t,
    setting: *const c_char,
) -> c_int {
    call("ecan_igh_config_set_ecrt", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { AdapterPlain::open(call, config)? };
        let text = if setting.is_null() {
            ""
        } else {
            // SAFETY: as above.
            unsafe { call.text("setting", setting)? }
        };
        config.ecrt = Text::new(call, "setting", text)?;
        config.is_ecrt_set = !setting.is_null();
        Ok(())
    })
}

/// Suggests the scenario for a plain "sim": "echo" (the default) or "drives".
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ARGUMENT, ECAN_ERR_BUFFER.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_suggest_scenario(
    config: *mut ecan_igh_config_t,
    name: *const c_char,
) -> c_int {
    call("ecan_igh_config_suggest_scenario", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (config, name) =
            unsafe { (AdapterPlain::open(call, config)?, call.text("name", name)?) };
        config.scenario = Text::new(call, "name", name)?;
        Ok(())
    })
}

/// Chooses the clock of a simulated master, unless its scenario does. The real library takes no
/// notice.
///
/// @param stepped  0: wall-clock time, the default. Else: the time passes only while the program
///                 waits for the next cycle, as fast as the machine goes; same seed, same result.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_stepped_clock(
    config: *mut ecan_igh_config_t,
    stepped: c_int,
) -> c_int {
    call("ecan_igh_config_set_stepped_clock", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { AdapterPlain::open(call, config)? }.is_stepped = stepped != 0;
        Ok(())
    })
}

/// Sets the seed of everything random in a simulation, in place of the scenario's.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_seed(
    config: *mut ecan_igh_config_t,
    seed: u64,
) -> c_int {
    call("ecan_igh_config_set_seed", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { AdapterPlain::open(call, config)? }.seed = Some(seed);
        Ok(())
    })
}

/// Chooses the EtherCAT master.
///
/// @param index  0 for /dev/EtherCAT0, the default.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_master_index(
    config: *mut ecan_igh_config_t,
    index: u32,
) -> c_int {
    call("ecan_igh_config_set_master_index", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { AdapterPlain::open(call, config)? }.master_index = index;
        Ok(())
    })
}

/// Sets the number of ECAN-Lite slaves; slave i is at position i unless that is changed.
///
/// @param count  1 to ECAN_IGH_MAX_SLAVES.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ARGUMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_slave_count(
    config: *mut ecan_igh_config_t,
    count: usize,
) -> c_int {
    call("ecan_igh_config_set_slave_count", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { AdapterPlain::open(call, config)? };
        if !(1..=ECAN_IGH_MAX_SLAVES).contains(&count) {
            let text = format_args!("{count} is not 1 to {ECAN_IGH_MAX_SLAVES}");
            return Err(call.argument("count", text));
        }
        config.slave_count = count;
        Ok(())
    })
}

/// Gets the number of slaves, as igh_mcan_port_load_config() found it in a file for example.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_get_slave_count(
    config: *const ecan_igh_config_t,
    count: *mut usize,
) -> c_int {
    call("ecan_igh_config_get_slave_count", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (config, out) =
            unsafe { (AdapterPlain::read(call, config)?, call.out("count", count)?) };
        out.set(config.slave_count);
        Ok(())
    })
}

/// Sets the period of the application's cycle.
///
/// @param cycle_us  Microseconds, 1 to 4294967. A sound one is 100 to 100000, and shorter than the
///                  watchdog: ecan_igh_config_set_watchdog_us().
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ARGUMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_cycle_us(
    config: *mut ecan_igh_config_t,
    cycle_us: u32,
) -> c_int {
    call("ecan_igh_config_set_cycle_us", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { AdapterPlain::open(call, config)? };
        config.cycle_ns = cycle_us.checked_mul(1000).filter(|ns| *ns > 0).ok_or_else(|| {
            let most = u32::MAX / 1000;
            call.argument("cycle_us", format_args!("{cycle_us} is not 1 to {most}"))
        })?;
        Ok(())
    })
}

/// Gets the period of the application's cycle.
///
/// @param cycle_ns  Nanoseconds: a file may have fractions of a microsecond.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_get_cycle_ns(
    config: *const ecan_igh_config_t,
    cycle_ns: *mut u32,
) -> c_int {
    call("ecan_igh_config_get_cycle_ns", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (config, out) =
            unsafe { (AdapterPlain::read(call, config)?, call.out("cycle_ns", cycle_ns)?) };
        out.set(config.cycle_ns);
        Ok(())
    })
}

/// States that the installed master carries more than 1486 bytes of process data per sync manager.
/// Without it N is at most 11 (ECAN_PDO_MAX_PLAIN_MULTIPLIER).
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_allow_large_pdos(
    config: *mut ecan_igh_config_t,
    allow: c_int,
) -> c_int {
    call("ecan_igh_config_allow_large_pdos", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { AdapterPlain::open(call, config)? }.allow_large_pdos = allow != 0;
        Ok(())
    })
}

/// Sets how long the slaves may take to answer in PREOP, in milliseconds; 10000 by default.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_preop_timeout_ms(
    config: *mut ecan_igh_config_t,
    timeout_ms: u32,
) -> c_int {
    call("ecan_igh_config_set_preop_timeout_ms", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { AdapterPlain::open(call, config)? }.preop_timeout_ms = timeout_ms;
        Ok(())
    })
}

/// Sets the process data watchdog of the gateways: one that gets no outputs for so long leaves OP
/// for SAFEOP (AL status code 0x001B) and sends no frames of the application any more.
///
/// @param watchdog_us  A multiple of 100 from 100 to 6553500, 100000 by default. Longer than two
///                     cycles, or a single lost frame ends operation.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED. The value is checked with the others
///          by ecan_igh_check_config() and ecan_igh_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_watchdog_us(
    config: *mut ecan_igh_config_t,
    watchdog_us: u32,
) -> c_int {
    call("ecan_igh_config_set_watchdog_us", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { AdapterPlain::open(call, config)? }.watchdog_us = watchdog_us;
        Ok(())
    })
}
