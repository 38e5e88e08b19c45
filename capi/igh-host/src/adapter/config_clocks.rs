//! Configuration of the distributed clocks

use std::ffi::c_int;
use std::time::Duration;

use ecan_c_boundary::result::ecan_result_t::{self, ECAN_ERR_ORDER};
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_host::{ClockSource, DcSync, Plan};

use super::config::{IghConfig, ecan_igh_config_t};
use crate::encoded::EncodedCall as _;

mirror! {
    /// The clock that the others follow.
    pub enum ecan_igh_clock_source_t as ClockSource {
        /// The host's: the reference clock is corrected to the application's time in each cycle.
        ECAN_IGH_CLOCK_HOST = 0 => ClockSource::Host,
        /// The reference clock: a phase-locked loop shifts the deadlines of the host's cycle.
        ECAN_IGH_CLOCK_REFERENCE = 1 => ClockSource::Reference,
    }
}

/// Settings of the distributed clocks; an error if they are off.
fn dc(call: Call, config: &mut IghConfig) -> Result<&mut DcSync, ecan_result_t> {
    let dc = config.adapter.dc.as_mut();
    dc.ok_or_else(|| call.fail(ECAN_ERR_ORDER, format_args!("distributed clocks are off")))
}

/// Enables distributed clocks with Sync0 (manual 8.4, 15.6). 15.6.1 lists proven phases.
///
/// @param cycle_us  Period of Sync0 in microseconds, a whole multiple of the cycle; 0 disables
///                  distributed clocks.
/// @param shift_us  Phase of Sync0 against the start of the period, in microseconds, below it.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT. ecan_igh_check_config() checks the period against the
///          cycle.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_sync0(config: *mut ecan_igh_config_t, cycle_us: u32, shift_us: u32) {
    let cycle = duration(call, "cycle_us", cycle_us)?;
    let shift = duration(call, "shift_us", shift_us)?;
    let before = config.adapter.dc.unwrap_or(DcSync::new(cycle, shift));
    config.adapter.dc = (!cycle.is_zero()).then_some(DcSync { cycle, shift, ..before });
}

/// Enables distributed clocks with Sync0, with the shift that the plan recommends: the middle between
/// the latest arrival of the outputs in a cycle and the earliest one in the next (manual 16.1).
///
/// Uses the slaves, their PDO sizes and the cycle that the configuration has now: call it after they
/// are set, and again when one of them changes. The times of the application, the host and the
/// firmware are those of igh_mcan_port_apply_config() if it was called, otherwise 100, 30 and 50 us. A
/// product measures its shift (manual 15.6.1) and sets it with ecan_igh_config_set_dc_sync0().
///
/// @param cycle_us  Period of Sync0 in microseconds, a whole multiple of the cycle; 0 disables
///                  distributed clocks.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_sync0_planned(config: *mut ecan_igh_config_t, cycle_us: u32) {
    let cycle = duration(call, "cycle_us", cycle_us)?;
    let times = |slave| config.image_times(slave);
    let DcSync { shift, .. } = DcSync::planned_with(cycle, &config.configured(), times);
    let before = config.adapter.dc.unwrap_or(DcSync::new(cycle, shift));
    config.adapter.dc = (!cycle.is_zero()).then_some(DcSync { cycle, shift, ..before });
}

/// Gets the Sync0 shift and its margin by the plan: the distance of the pulses from the arrivals of
/// the outputs. If it is negative, outputs may be missed (manual 16.1).
///
/// @param shift_ns   Gets the shift in nanoseconds.
/// @param margin_ns  Gets the margin in nanoseconds; 0 without slaves.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 or _planned
/// @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
#[export(call)]
pub fn ecan_igh_config_get_dc_margin(
    config: *const ecan_igh_config_t,
    shift_ns: *mut u32,
    margin_ns: *mut i64,
) {
    pointers!(call, encoded(config), out(shift_ns), out(margin_ns));
    let Some(dc) = config.adapter.dc else {
        return Err(call.fail(ECAN_ERR_ORDER, format_args!("distributed clocks are off")));
    };
    let plan = Plan::with_times(&config.configured(), |slave| config.image_times(slave));
    let arrivals = plan.output_arrivals();
    shift_ns.set(dc.shift_ns());
    margin_ns.set(arrivals.map_or(0, |arrivals| arrivals.margin_ns(dc.shift_ns())));
}

fn duration(call: Call, name: &'static str, us: u32) -> Result<Duration, ecan_result_t> {
    let most = u32::MAX / 1000;
    if us > most {
        let text = format_args!("{us} is out of range; allowed: 0 to {most}");
        return Err(call.argument(name, text));
    }
    Ok(Duration::from_micros(us.into()))
}

/// Sets the AssignActivate word of the slaves' distributed clocks; 0x0300 by default.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_assign_activate(config: *mut ecan_igh_config_t, word: u16) {
    dc(call, config)?.assign_activate = word;
}

/// Selects the clock that the others follow; the host's by default.
///
/// @param source  An ecan_igh_clock_source_t.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT; ECAN_ERR_ORDER if distributed clocks are off.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_source(config: *mut ecan_igh_config_t, source: c_int) {
    dc(call, config)?.source = ecan_igh_clock_source_t::to_rust(source).ok_or_else(|| {
        call.argument("source", format_args!("{source} is invalid; allowed: 0, 1"))
    })?;
}

/// Selects the slave whose clock is the reference; by default the first on the bus with a clock.
///
/// @param slave  Slave index; ecan_igh_check_config() checks it.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_reference(config: *mut ecan_igh_config_t, slave: usize) {
    dc(call, config)?.reference = Some(slave);
}

/// Sets the interval at which the differences between the slaves' clocks are measured; 100 cycles
/// by default.
///
/// @param every  Cycles from measurement to measurement; 0 for never.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_monitor(config: *mut ecan_igh_config_t, every: u32) {
    dc(call, config)?.monitor_every = every;
}
