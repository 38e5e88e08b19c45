//! Configuration of the distributed clocks

use std::ffi::c_int;

use ecan_host::{ClockSource, DcSync};
use ecan_mcan_host::boundary::{Call, call};
use ecan_mcan_host::common::result::ecan_result_t;

use super::config::{AdapterPlain, ecan_igh_config_t};

/// Which clock the others follow.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ecan_igh_clock_source_t {
    /// The host's: the reference clock is corrected to the application's time in each cycle.
    ECAN_IGH_CLOCK_HOST = 0,
    /// The reference clock's: a phase-locked loop shifts the points of the host's cycle.
    ECAN_IGH_CLOCK_REFERENCE = 1,
}

fn need_dc(call: Call, config: &mut AdapterPlain) -> Result<&mut DcSync, ecan_result_t> {
    config.dc.as_mut().ok_or_else(|| {
        call.fail(ecan_result_t::ECAN_ERR_ORDER, format_args!("distributed clocks are off"))
    })
}

/// Switches distributed clocks with Sync0 on (manual 8.4, 15.6). 15.6.1 lists proven phases.
///
/// @param cycle_us  Period of Sync0 in microseconds, a whole multiple of the cycle; 0 switches
///                  distributed clocks off.
/// @param shift_us  Phase of Sync0 against the start of the period, in microseconds, below it.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ARGUMENT. Whether it fits
///          the cycle is told by ecan_igh_check_config().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_dc_sync0(
    config: *mut ecan_igh_config_t,
    cycle_us: u32,
    shift_us: u32,
) -> c_int {
    call("ecan_igh_config_set_dc_sync0", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { AdapterPlain::open(call, config)? };
        let ns = |name, us: u32| {
            let most = u32::MAX / 1000;
            us.checked_mul(1000)
                .ok_or_else(|| call.argument(name, format_args!("{us} is above {most}")))
        };
        let (cycle_ns, shift_ns) = (ns("cycle_us", cycle_us)?, ns("shift_us", shift_us)?);
        let before = config.dc.unwrap_or(DcSync::new(cycle_ns, shift_ns));
        config.dc = (cycle_ns > 0).then_some(DcSync { cycle_ns, shift_ns, ..before });
        Ok(())
    })
}

/// Sets the AssignActivate word of the slaves' distributed clocks; 0x0300 by default.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED; ECAN_ERR_ORDER where distributed
///          clocks are off.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_dc_assign_activate(
    config: *mut ecan_igh_config_t,
    word: u16,
) -> c_int {
    call("ecan_igh_config_set_dc_assign_activate", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { AdapterPlain::open(call, config)? };
        need_dc(call, config)?.assign_activate = word;
        Ok(())
    })
}

/// Chooses which clock the others follow; the host's by default.
///
/// @param source  An ecan_igh_clock_source_t.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ARGUMENT; ECAN_ERR_ORDER
///          where distributed clocks are off.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_dc_source(
    config: *mut ecan_igh_config_t,
    source: c_int,
) -> c_int {
    call("ecan_igh_config_set_dc_source", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { AdapterPlain::open(call, config)? };
        let dc = need_dc(call, config)?;
        dc.source = match source {
            0 => ClockSource::Host,
            1 => ClockSource::Reference,
            _ => {
                let text = format_args!("{source} is no ecan_igh_clock_source_t");
                return Err(call.argument("source", text));
            }
        };
        Ok(())
    })
}

/// Chooses the slave whose clock is the reference; by default the first on the bus that has one.
///
/// @param slave  Slave index; whether there is such a slave is told by ecan_igh_check_config().
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED; ECAN_ERR_ORDER where distributed
///          clocks are off.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_dc_reference(
    config: *mut ecan_igh_config_t,
    slave: usize,
) -> c_int {
    call("ecan_igh_config_set_dc_reference", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { AdapterPlain::open(call, config)? };
        need_dc(call, config)?.reference = Some(slave);
        Ok(())
    })
}

/// Sets how often the differences between the slaves' clocks are measured; every 100 cycles by
/// default.
///
/// @param every  Cycles from measurement to measurement; 0 is never.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED; ECAN_ERR_ORDER where distributed
///          clocks are off.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_set_dc_monitor(
    config: *mut ecan_igh_config_t,
    every: u32,
) -> c_int {
    call("ecan_igh_config_set_dc_monitor", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { AdapterPlain::open(call, config)? };
        need_dc(call, config)?.monitor_every = every;
        Ok(())
    })
}
