//! Functions for the configuration of slaves, PDO lists and domains, and for activation.

use std::ffi::CStr;
use std::slice;
use std::sync::Arc;

use ecrt_sys::{
    EC_DIR_INPUT, EC_DIR_OUTPUT, EC_MAX_SYNC_MANAGERS, EC_WD_DEFAULT, EC_WD_DISABLE, EC_WD_ENABLE,
    ec_al_state_t, ec_direction_t, ec_domain_t, ec_master_t, ec_pdo_entry_reg_t, ec_pdo_info_t,
    ec_sdo_request_t, ec_slave_config_state_t, ec_slave_config_t, ec_sync_info_t,
    ec_watchdog_mode_t,
};
use libc::{c_char, c_int, c_uint, size_t};

use super::boundary;
use super::boundary::{
    CallResult, Target, bytes, change_config, change_sync, guarded, handle_or_null, on_config,
    on_domain, on_master, pointer, status, store,
};
use crate::ecrt::domain::{Pdo, PdoEntry, SyncWatchdog};
use crate::ecrt::sdo_transfer::{RequestId, SdoObject};
use crate::ecrt::slaves::{DcConfig, EntrySelector, SdoRequest, StartupSdo};
use crate::ecrt::timing::ACTIVATE_NS;
use crate::world::ProcessDirection;

/// AL state bits of OP.
const OPERATIONAL: u8 = 8;

/// Takes an emergency of the slave. IgH takes it with the response of an SDO transfer.
fn take_emergency(config: *const ec_slave_config_t) -> CallResult<[u8; 8]> {
    let call = on_config(config)?;
    call.with(|state| {
        let slave = state.master.slave_of(call.object)?.ok_or(libc::ENOENT)?;
        let taken = state
            .world
            .with_gateway_in(slave.slot, |gateway, _| gateway.parts().0.take_emergency());
        taken.flatten().map(crate::gateway::Emergency::message).ok_or(libc::ENOENT)
    })
}

pub unsafe extern "C" fn master_create_domain(master: *mut ec_master_t) -> *mut ec_domain_t {
    handle_or_null(|| {
        let call = on_master(master)?;
        let index = call.configuring(|state| Ok(state.master.configs.add_domain()))?;
        Ok(call.insert(Target::Domain(index)))
    })
}

pub unsafe extern "C" fn master_slave_config(
    master: *mut ec_master_t,
    alias: u16,
    position: u16,
    vendor_id: u32,
    product_code: u32,
) -> *mut ec_slave_config_t {
    handle_or_null(|| {
        let call = on_master(master)?;
        let index = call.configuring(|state| {
            state.master.slave_config(alias, position, vendor_id, product_code)
        })?;
        let target = Target::Config(index);
        Ok(call.address_of(target).unwrap_or_else(|| call.insert(target)))
    })
}

pub unsafe extern "C" fn slave_config_create_sdo_request(
    config: *mut ec_slave_config_t,
    index: u16,
    subindex: u8,
    size: size_t,
) -> *mut ec_sdo_request_t {
    handle_or_null(|| {
        let call = on_config(config)?;
        let request = call.configuring(|state| {
            let requests = &mut state.master.config(call.object)?.requests;
            requests.push(SdoRequest::new(index, subindex, size));
            Ok(requests.len() - 1)
        })?;
        Ok(call.insert(Target::Request(RequestId { config: call.object, request })))
    })
}

/// Registers a mapped entry in a domain of the same master handle. Returns the byte offset, and the
/// bit in an out-parameter; without that, an entry inside a byte is an error.
///
/// # Safety
/// `bit_position` is null or valid for writing.
pub(super) unsafe fn register_entry(
    config: *mut ec_slave_config_t,
    entry: EntrySelector,
    domain: *mut ec_domain_t,
    bit_position: *mut c_uint,
) -> c_int {
    let byte = guarded(|| {
        let (call, domain) = (on_config(config)?, on_domain(domain)?);
        if !Arc::ptr_eq(&call.shared, &domain.shared) || call.client != domain.client {
            return Err(libc::ENOENT);
        }
        let (byte, bit) = call.configuring(|state| {
            let config = state.master.config(call.object)?;
            let (sync, direction, size, bit) = config.locate(entry).ok_or(libc::ENOENT)?;
            let direction = direction.ok_or(libc::EINVAL)?;
            let domain = state.master.configs.domain(domain.object)?;
            let base = domain.add_fmmu(call.object, sync, direction, size);
            Ok((base + bit / 8, (bit % 8) as c_uint))
        })?;
        if bit != 0 || !bit_position.is_null() {
            // SAFETY: the caller's promise.
            unsafe { store(bit_position, bit)? };
        }
        c_int::try_from(byte).map_err(|_| libc::EOVERFLOW)
    });
    byte.unwrap_or_else(|errno| -errno)
}

pub unsafe extern "C" fn slave_config_reg_pdo_entry(
    config: *mut ec_slave_config_t,
    entry_index: u16,
    entry_subindex: u8,
    domain: *mut ec_domain_t,
    bit_position: *mut c_uint,
) -> c_int {
    let entry = EntrySelector::Object { index: entry_index, subindex: entry_subindex };
    // SAFETY: the caller passes a pointer for the bit position, or null.
    unsafe { register_entry(config, entry, domain, bit_position) }
}

fn add_startup_sdo(config: *mut ec_slave_config_t, object: SdoObject, data: Vec<u8>) -> CallResult {
    change_config(config, |config| {
        config.sdos.push(StartupSdo { object, data });
        Ok(())
    })
}

functions! {
    one_form master_select_reference_clock(
        master: *mut ec_master_t, config: *mut ec_slave_config_t
    ) {
        let config = if config.is_null() { None } else { Some(on_config(config)?.object) };
        on_master(master)?.configuring(|state| {
            state.master.clocks.select_reference(config);
            Ok(())
        })
    }

    one_form master_set_send_interval(master: *mut ec_master_t, interval_us: size_t) {
        if interval_us == 0 {
            return Err(libc::EINVAL);
        }
        on_master(master)?.driving(|_| Ok(()))
    }

    // takes time, because the master's threads are exchanged
    one_form master_activate(master: *mut ec_master_t) {
        let call = on_master(master)?;
        let done = call.driving(|state| {
            let now = state.world.now_ns();
            let fresh = !state.master.reservation.is_active();
            if fresh {
                state.master.activate(&state.world);
            }
            Ok(fresh.then_some(now + ACTIVATE_NS))
        })?;
        if let Some(done) = done {
            call.shared.sleep_until(done);
        }
        Ok(())
    }

    // all handles made from the master become invalid
    two_forms master_deactivate(master: *mut ec_master_t) {
        let call = on_master(master)?;
        call.driving(|state| {
            state.master.deactivate(&state.world);
            Ok(())
        })?;
        boundary::forget(&call.shared, call.client, false);
        Ok(())
    }

    one_form slave_config_sync_manager(
        config: *mut ec_slave_config_t, sync_index: u8, direction: ec_direction_t,
        watchdog: ec_watchdog_mode_t
    ) {
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
        change_sync(config, sync_index, |sync| {
            (sync.direction, sync.watchdog) = (Some(direction), watchdog);
        })
    }

    two_forms slave_config_watchdog(
        config: *mut ec_slave_config_t, divider: u16, intervals: u16
    ) {
        change_config(config, |config| {
            config.watchdog = (divider, intervals);
            Ok(())
        })
    }

    one_form slave_config_pdo_assign_add(
        config: *mut ec_slave_config_t, sync_index: u8, pdo_index: u16
    ) {
        let call = on_config(config)?;
        call.configuring(|state| {
            let slave = state.master.slave_of(call.object)?;
            let mut known = slave.iter().flat_map(|slave| slave.assigned.iter().flatten());
            let known = known.find(|pdo| pdo.index == pdo_index).cloned();
            let pdo = known.unwrap_or(Pdo { index: pdo_index, entries: Vec::new() });
            let config = state.master.config(call.object)?;
            config.syncs.get_mut(usize::from(sync_index)).ok_or(libc::EINVAL)?.pdos.push(pdo);
            Ok(())
        })
    }

    two_forms slave_config_pdo_assign_clear(config: *mut ec_slave_config_t, sync_index: u8) {
        change_sync(config, sync_index, |sync| sync.pdos.clear())
    }

    one_form slave_config_pdo_mapping_add(
        config: *mut ec_slave_config_t, pdo_index: u16, entry_index: u16, entry_subindex: u8,
        entry_bits: u8
    ) {
        let entry = PdoEntry { index: entry_index, subindex: entry_subindex, bits: entry_bits };
        change_config(config, |config| {
            config.find_pdo(pdo_index).ok_or(libc::ENOENT)?.entries.push(entry);
            Ok(())
        })
    }

    two_forms slave_config_pdo_mapping_clear(config: *mut ec_slave_config_t, pdo_index: u16) {
        change_config(config, |config| {
            if let Some(pdo) = config.find_pdo(pdo_index) {
                pdo.entries.clear();
            }
            Ok(())
        })
    }

    two_forms slave_config_dc(
        config: *mut ec_slave_config_t, assign_activate: u16, sync0_cycle: u32, sync0_shift: i32,
        sync1_cycle: u32, _sync1_shift: i32
    ) {
        change_config(config, |config| {
            config.dc = Some(DcConfig { assign_activate, sync0_cycle, sync0_shift, sync1_cycle });
            Ok(())
        })
    }

    one_form slave_config_sdo(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, data: *const u8, size: size_t
    ) {
        // SAFETY: the caller passes `size` bytes, or null.
        add_startup_sdo(config, SdoObject::entry(index, subindex), unsafe { bytes(data, size)? })
    }

    /// One byte.
    one_form slave_config_sdo8(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u8
    ) {
        add_startup_sdo(config, SdoObject::entry(index, subindex), vec![value])
    }

    /// Two bytes.
    one_form slave_config_sdo16(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u16
    ) {
        let data = value.to_le_bytes().to_vec();
        add_startup_sdo(config, SdoObject::entry(index, subindex), data)
    }

    /// Four bytes.
    one_form slave_config_sdo32(
        config: *mut ec_slave_config_t, index: u16, subindex: u8, value: u32
    ) {
        let data = value.to_le_bytes().to_vec();
        add_startup_sdo(config, SdoObject::entry(index, subindex), data)
    }

    /// A whole object by Complete Access, which the gateway rejects at startup.
    one_form slave_config_complete_sdo(
        config: *mut ec_slave_config_t, index: u16, data: *const u8, size: size_t
    ) {
        // SAFETY: the caller passes `size` bytes, or null.
        add_startup_sdo(config, SdoObject::whole(index), unsafe { bytes(data, size)? })
    }

    // accepted without effect
    one_form slave_config_flag(config: *mut ec_slave_config_t, key: *const c_char, _value: i32) {
        on_config(config)?;
        if key.is_null() {
            return Err(libc::EFAULT);
        }
        // SAFETY: not null, so a text that ends with a zero.
        if unsafe { CStr::from_ptr(key) }.is_empty() {
            return Err(libc::EINVAL);
        }
        change_config(config, |_| Ok(()))
    }

    one_form slave_config_state_timeout(
        config: *mut ec_slave_config_t, from: ec_al_state_t, to: ec_al_state_t, timeout_ms: c_uint
    ) {
        let state = |state: ec_al_state_t| u8::try_from(state).map_err(|_| libc::EINVAL);
        let limit = (state(from)?, state(to)?, u64::from(timeout_ms) * 1_000_000);
        change_config(config, |config| {
            config.state_timeouts.push(limit);
            Ok(())
        })
    }

    two_forms slave_config_state(
        config: *const ec_slave_config_t, state: *mut ec_slave_config_state_t
    ) {
        let call = on_config(config)?;
        let mut value = ec_slave_config_state_t::default();
        call.with(|state| {
            if let Some(slave) = state.master.slave_of(call.object)? {
                let operational = slave.current == OPERATIONAL
                    && !slave.force_config
                    && slave.startup.is_none();
                value.set_online(1);
                value.set_operational(c_uint::from(operational));
                value.set_al_state(c_uint::from(slave.current & 0x0F));
            }
            Ok(())
        })?;
        // SAFETY: the caller passes a pointer for the state, or null.
        unsafe { store(state, value) }
    }

    /// Size of the queue of emergency messages (CoE). The gateway keeps them: they need no queue.
    one_form slave_config_emerg_size(config: *mut ec_slave_config_t, _elements: size_t) {
        change_config(config, |_| Ok(()))
    }

    /// `ENOENT` without an emergency message.
    one_form slave_config_emerg_pop(config: *mut ec_slave_config_t, target: *mut u8) {
        let message = take_emergency(config)?;
        // SAFETY: the caller passes a pointer to eight bytes, or null.
        unsafe { store(target.cast(), message) }
    }

    /// Clears emergency messages and overruns.
    one_form slave_config_emerg_clear(config: *mut ec_slave_config_t) {
        on_config(config)?;
        while take_emergency(config).is_ok() {}
        Ok(())
    }

    /// Number of lost emergency messages.
    one_form slave_config_emerg_overruns(config: *const ec_slave_config_t) {
        on_config(config).map(drop)
    }
}

/// Index that ends a list of sync managers.
const END_OF_SYNCS: u8 = 0xFF;

/// Return value of the called functions: a status, or a byte offset.
fn checked(result: c_int) -> CallResult<c_int> {
    if result < 0 { Err(-result) } else { Ok(result) }
}

/// A list of the caller, empty if null.
///
/// # Safety
/// `first` is null or valid for reading `count` elements.
unsafe fn list<'a, T>(first: *const T, count: c_uint) -> &'a [T] {
    if first.is_null() {
        return &[];
    }
    // SAFETY: not null, so valid for reading by the caller's promise.
    unsafe { slice::from_raw_parts(first, count as usize) }
}

/// Sync managers with their PDOs and entries, up to the given number or
/// index 0xFF. Those before a rejected one stay configured.
pub unsafe extern "C" fn slave_config_pdos(
    config: *mut ec_slave_config_t,
    sync_count: c_uint,
    syncs: *const ec_sync_info_t,
) -> c_int {
    status(|| {
        // the list may end before the given number, which EC_END sets to the maximum
        for index in 0..if syncs.is_null() { 0 } else { sync_count as usize } {
            // SAFETY: the caller passes this number of elements, or ends the list after this one.
            let sync = unsafe { &*syncs.add(index) };
            if sync.index == END_OF_SYNCS {
                break;
            }
            // SAFETY: as above, and so for the lists in it.
            unsafe { configure_sync(config, sync)? };
        }
        Ok(())
    })
}

/// # Safety
/// The lists in `sync` are null or valid for reading the number of elements that it gives.
unsafe fn configure_sync(config: *mut ec_slave_config_t, sync: &ec_sync_info_t) -> CallResult {
    if u32::from(sync.index) >= EC_MAX_SYNC_MANAGERS {
        return Err(libc::ENOENT);
    }
    // SAFETY: these take no memory of the caller's.
    unsafe {
        checked(slave_config_sync_manager(config, sync.index, sync.dir, sync.watchdog_mode))?;
        checked(slave_config_pdo_assign_clear(config, sync.index))?;
    }
    // SAFETY: the caller's promise.
    for pdo in unsafe { list(sync.pdos, sync.n_pdos) } {
        // SAFETY: the caller's promise.
        unsafe { configure_pdo(config, sync.index, pdo)? };
    }
    Ok(())
}

/// # Safety
/// The list in `pdo` is null or valid for reading the number of elements that it gives.
unsafe fn configure_pdo(
    config: *mut ec_slave_config_t,
    sync: u8,
    pdo: &ec_pdo_info_t,
) -> CallResult {
    // SAFETY: these take no memory of the caller's.
    unsafe {
        checked(slave_config_pdo_assign_add(config, sync, pdo.index))?;
        checked(slave_config_pdo_mapping_clear(config, pdo.index))?;
    }
    // SAFETY: the caller's promise.
    for entry in unsafe { list(pdo.entries, pdo.n_entries) } {
        let (index, subindex, bits) = (entry.index, entry.subindex, entry.bit_length);
        // SAFETY: as above.
        let result =
            unsafe { slave_config_pdo_mapping_add(config, pdo.index, index, subindex, bits) };
        checked(result)?;
    }
    Ok(())
}

/// Registers an entry in a domain by the positions of sync
/// manager, PDO and entry; returns its byte offset.
pub unsafe extern "C" fn slave_config_reg_pdo_entry_pos(
    config: *mut ec_slave_config_t,
    sync_index: u8,
    pdo_position: c_uint,
    entry_position: c_uint,
    domain: *mut ec_domain_t,
    bit_position: *mut c_uint,
) -> c_int {
    if u32::from(sync_index) >= EC_MAX_SYNC_MANAGERS {
        return -libc::EINVAL;
    }
    let (pdo, entry) = (pdo_position as usize, entry_position as usize);
    let entry = EntrySelector::Position { sync: sync_index, pdo, entry };
    // SAFETY: the caller passes a pointer for the bit position, or null.
    unsafe { register_entry(config, entry, domain, bit_position) }
}

/// Registers entries of any slaves in a domain, up to the one
/// with index 0.
pub unsafe extern "C" fn domain_reg_pdo_entry_list(
    domain: *mut ec_domain_t,
    entries: *const ec_pdo_entry_reg_t,
) -> c_int {
    status(|| {
        let master = on_domain(domain)?.address_of(Target::Master).ok_or(libc::EINVAL)?;
        if entries.is_null() {
            return Err(libc::EFAULT);
        }
        for index in 0.. {
            // SAFETY: the caller ends the list after this element.
            let entry = unsafe { &*entries.add(index) };
            if entry.index == 0 {
                break;
            }
            let master = pointer(master);
            let (vendor, product) = (entry.vendor_id, entry.product_code);
            // SAFETY: the bit position is a pointer of the caller, or null.
            let offset = unsafe {
                let config =
                    master_slave_config(master, entry.alias, entry.position, vendor, product);
                if config.is_null() {
                    return Err(libc::ENOENT);
                }
                let (index, subindex) = (entry.index, entry.subindex);
                slave_config_reg_pdo_entry(config, index, subindex, domain, entry.bit_position)
            };
            // SAFETY: the offset is a pointer of the caller, or null.
            unsafe { store(entry.offset, checked(offset)? as c_uint)? };
        }
        Ok(())
    })
}
