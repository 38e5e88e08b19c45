//! Configuration and activation.

use std::ffi::CStr;

use super::{
    byte_offset, entry_offset, handle_or_null, on_config, on_domain, on_master, status, store,
};
use crate::ecrt::pdo::PdoEntry;
use crate::ecrt::slave_config::{DcConfig, EntrySelector, SyncWatchdog};
use crate::world::ProcessDirection;
use ecrt_sys::{
    EC_DIR_INPUT, EC_DIR_OUTPUT, EC_WD_DEFAULT, EC_WD_DISABLE, EC_WD_ENABLE, ec_al_state_t,
    ec_direction_t, ec_domain_t, ec_master_t, ec_sdo_request_t, ec_slave_config_state_t,
    ec_slave_config_t, ec_watchdog_mode_t,
};
use libc::{c_char, c_int, c_uint, size_t};

/// `ecrt_master_create_domain`: creates a domain.
pub unsafe extern "C" fn master_create_domain(master: *mut ec_master_t) -> *mut ec_domain_t {
    handle_or_null(|| on_master(master).and_then(|call| call.create_domain()))
}

/// `ecrt_master_slave_config`: creates or finds the configuration of a slave.
pub unsafe extern "C" fn master_slave_config(
    master: *mut ec_master_t,
    alias: u16,
    position: u16,
    vendor_id: u32,
    product_code: u32,
) -> *mut ec_slave_config_t {
    handle_or_null(|| {
        on_master(master)
            .and_then(|call| call.slave_config(alias, position, vendor_id, product_code))
    })
}

/// `ecrt_master_select_reference_clock`: selects the reference clock.
pub unsafe extern "C" fn master_select_reference_clock(
    master: *mut ec_master_t,
    config: *mut ec_slave_config_t,
) -> c_int {
    status(|| {
        let config = if config.is_null() { None } else { Some(on_config(config)?) };
        on_master(master)?.select_reference_clock(config.as_ref())
    })
}

/// `ecrt_master_set_send_interval`: sets the interval between sends.
pub unsafe extern "C" fn master_set_send_interval(
    master: *mut ec_master_t,
    interval_us: size_t,
) -> c_int {
    status(|| {
        let call = on_master(master)?;
        if interval_us == 0 {
            return Err(libc::EINVAL);
        }
        call.driving(|_| ())
    })
}

/// `ecrt_master_activate`: ends configuration, starts the operation phase.
pub unsafe extern "C" fn master_activate(master: *mut ec_master_t) -> c_int {
    status(|| on_master(master).and_then(|call| call.activate()))
}

two_forms!(
    /// `ecrt_master_deactivate`: ends the operation phase; all handles made from the master become
    /// invalid.
    master_deactivate / master_deactivate_silent(master: *mut ec_master_t) {
    on_master(master)?.deactivate()
});

/// `ecrt_slave_config_sync_manager`: direction and watchdog of a sync manager.
pub unsafe extern "C" fn slave_config_sync_manager(
    config: *mut ec_slave_config_t,
    sync_index: u8,
    direction: ec_direction_t,
    watchdog: ec_watchdog_mode_t,
) -> c_int {
    status(|| {
        let call = on_config(config)?;
        let direction = match direction {
            EC_DIR_OUTPUT => ProcessDirection::Output,
            EC_DIR_INPUT => ProcessDirection::Input,
            _ => return Err(libc::EINVAL),
        };
        let watchdog = match watchdog {
            EC_WD_DEFAULT => SyncWatchdog::Default,
            EC_WD_ENABLE => SyncWatchdog::Enable,
            EC_WD_DISABLE => SyncWatchdog::Disable,
            _ => return Err(libc::EINVAL),
        };
        call.change_sync(sync_index, |sync| {
            (sync.direction, sync.watchdog) = (Some(direction), watchdog);
            Ok(())
        })
    })
}

two_forms!(
    /// `ecrt_slave_config_watchdog`: divider and intervals of the watchdog.
    slave_config_watchdog / slave_config_watchdog_silent(
    config: *mut ec_slave_config_t, divider: u16, intervals: u16) {
    on_config(config)?.change(|config| {
        config.watchdog = (divider, intervals);
        Ok(())
    })
});

/// `ecrt_slave_config_pdo_assign_add`: adds a PDO to a sync manager.
pub unsafe extern "C" fn slave_config_pdo_assign_add(
    config: *mut ec_slave_config_t,
    sync_index: u8,
    pdo_index: u16,
) -> c_int {
    status(|| on_config(config).and_then(|call| call.assign_pdo(sync_index, pdo_index)))
}

two_forms!(
    /// `ecrt_slave_config_pdo_assign_clear`: removes all PDOs of a sync manager.
    slave_config_pdo_assign_clear / slave_config_pdo_assign_clear_silent(
    config: *mut ec_slave_config_t, sync_index: u8) {
    on_config(config)?.change_sync(sync_index, |sync| {
        sync.pdos.clear();
        Ok(())
    })
});

/// `ecrt_slave_config_pdo_mapping_add`: adds an entry to a PDO.
pub unsafe extern "C" fn slave_config_pdo_mapping_add(
    config: *mut ec_slave_config_t,
    pdo_index: u16,
    entry_index: u16,
    entry_subindex: u8,
    entry_bits: u8,
) -> c_int {
    status(|| {
        let call = on_config(config)?;
        let entry = PdoEntry { index: entry_index, subindex: entry_subindex, bits: entry_bits };
        call.change(
            |config| {
                if config.add_entry(pdo_index, entry) { Ok(()) } else { Err(libc::ENOENT) }
            },
        )
    })
}

two_forms!(
    /// `ecrt_slave_config_pdo_mapping_clear`: removes all entries of a PDO.
    slave_config_pdo_mapping_clear / slave_config_pdo_mapping_clear_silent(
    config: *mut ec_slave_config_t, pdo_index: u16) {
    on_config(config)?.change(|config| {
        if let Some(pdo) = config.find_pdo(pdo_index) {
            pdo.entries.clear();
        }
        Ok(())
    })
});

/// `ecrt_slave_config_reg_pdo_entry`: registers an entry in a domain; returns its byte offset.
pub unsafe extern "C" fn slave_config_reg_pdo_entry(
    config: *mut ec_slave_config_t,
    entry_index: u16,
    entry_subindex: u8,
    domain: *mut ec_domain_t,
    bit_position: *mut c_uint,
) -> c_int {
    byte_offset(|| {
        let call = on_config(config)?;
        let domain = on_domain(domain)?;
        let entry = EntrySelector::Object { index: entry_index, subindex: entry_subindex };
        let place = call.register_entry(entry, &domain)?;
        // SAFETY: the caller passes a place for the bit position, or null.
        unsafe { entry_offset(place, bit_position) }
    })
}

two_forms!(
    /// `ecrt_slave_config_dc`: distributed clocks of a slave.
    slave_config_dc / slave_config_dc_silent(
    config: *mut ec_slave_config_t, assign_activate: u16, sync0_cycle: u32, sync0_shift: i32,
    sync1_cycle: u32, _sync1_shift: i32) {
    on_config(config)?.change(|config| {
        config.dc = Some(DcConfig { assign_activate, sync0_cycle, sync0_shift, sync1_cycle });
        Ok(())
    })
});

/// `ecrt_slave_config_flag`: a named flag; accepted without effect.
pub unsafe extern "C" fn slave_config_flag(
    config: *mut ec_slave_config_t,
    key: *const c_char,
    _value: i32,
) -> c_int {
    status(|| {
        let call = on_config(config)?;
        if key.is_null() {
            return Err(libc::EFAULT);
        }
        // SAFETY: not null, so a text that ends with a zero.
        if unsafe { CStr::from_ptr(key) }.is_empty() {
            return Err(libc::EINVAL);
        }
        call.change(|_| Ok(()))
    })
}

/// `ecrt_slave_config_state_timeout`: longest time of a state change.
pub unsafe extern "C" fn slave_config_state_timeout(
    config: *mut ec_slave_config_t,
    from: ec_al_state_t,
    to: ec_al_state_t,
    timeout_ms: c_uint,
) -> c_int {
    status(|| {
        let call = on_config(config)?;
        let state = |state: ec_al_state_t| u8::try_from(state).map_err(|_| libc::EINVAL);
        let limit = (state(from)?, state(to)?, u64::from(timeout_ms) * 1_000_000);
        call.change(|config| {
            config.state_timeouts.push(limit);
            Ok(())
        })
    })
}

two_forms!(
    /// `ecrt_slave_config_state`: state of the slave.
    slave_config_state / slave_config_state_silent(
    config: *const ec_slave_config_t, state: *mut ec_slave_config_state_t) {
    let (slave, operational) = on_config(config)?.state()?;
    let mut value = ec_slave_config_state_t::default();
    value.set_online(c_uint::from(slave.online));
    value.set_operational(c_uint::from(operational));
    value.set_al_state(c_uint::from(slave.al_state));
    // SAFETY: the caller passes a place for the state, or null.
    unsafe { store(state, value) }
});

/// `ecrt_slave_config_create_sdo_request`: an SDO request that runs in parallel with the cycle.
pub unsafe extern "C" fn slave_config_create_sdo_request(
    config: *mut ec_slave_config_t,
    index: u16,
    subindex: u8,
    size: size_t,
) -> *mut ec_sdo_request_t {
    handle_or_null(|| {
        on_config(config).and_then(|call| call.create_sdo_request(index, subindex, size))
    })
}
