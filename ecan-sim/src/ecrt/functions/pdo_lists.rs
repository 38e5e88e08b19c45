//! PDOs and entries by lists, and entries by position.

use std::slice;

use super::configuration::register_entry;
use super::{
    master_slave_config, on_domain, slave_config_pdo_assign_add, slave_config_pdo_assign_clear,
    slave_config_pdo_mapping_add, slave_config_pdo_mapping_clear, slave_config_reg_pdo_entry,
    slave_config_sync_manager, status,
};
use crate::ecrt::calls::CallResult;
use crate::ecrt::registry::Target;
use crate::ecrt::slave_config::EntrySelector;
use ecrt_sys::{
    EC_MAX_SYNC_MANAGERS, ec_domain_t, ec_pdo_entry_reg_t, ec_pdo_info_t, ec_slave_config_t,
    ec_sync_info_t,
};
use libc::{c_int, c_uint};

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
            let master = super::pointer(master);
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
            unsafe { super::store(entry.offset, checked(offset)? as c_uint)? };
        }
        Ok(())
    })
}
