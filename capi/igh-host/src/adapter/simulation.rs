//! Simulated bus
//!
//! The setting "sim" of ecan_igh_config_set_ecrt(), or of the environment variable ECAN_ECRT, selects
//! the built-in simulator. The settings have no effect on a real bus.

use std::ffi::{c_char, c_int};

use ecan_c_boundary::pointers;
use ecan_c_export::export;

use super::config::{Text, ecan_igh_config_t};
use super::context::ecan_igh_context_t;

/// Suggests the scenario for a plain "sim": "echo" (the default) or "drives".
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT, ECAN_ERR_BUFFER.
#[export(call, config config)]
pub fn ecan_igh_config_suggest_scenario(config: *mut ecan_igh_config_t, name: *const c_char) {
    pointers!(call, text(name));
    config.scenario = Text::new(call, "name", name)?;
}

/// Selects the clock of a simulated master, unless its scenario does. A real library ignores it.
///
/// @param stepped  0: wall-clock time, the default. Else: time passes only while the program waits
///                 for the next cycle, as fast as the machine allows; same seed, same result.
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_set_stepped_clock(config: *mut ecan_igh_config_t, stepped: c_int) {
    config.is_stepped = stepped != 0;
}

/// Sets the seed of a simulation, in place of the scenario's.
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_set_seed(config: *mut ecan_igh_config_t, seed: u64) {
    config.seed = Some(seed);
}

/// Returns 1 if the bus is simulated.
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
#[export(_, layer adapter, or 0)]
pub fn ecan_igh_is_simulated(context: *mut ecan_igh_context_t) -> c_int {
    Ok(adapter.is_simulated().into())
}

/// Returns 1 if time passes only while the program waits for the next cycle: in a simulation with a
/// stepped clock. The program must then take its own deadlines from ecan_igh_now_ns().
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
#[export(_, bus bus, or 0)]
pub fn ecan_igh_clock_is_stepped(context: *mut ecan_igh_context_t) -> c_int {
    Ok(bus.is_stepped.into())
}
