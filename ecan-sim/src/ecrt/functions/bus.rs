//! Looking at the bus, and blocking transfers.

use super::{bytes, on_master, status, store};
use crate::ecrt::front::State;
use crate::ecrt::slave_view::{SYNC_MANAGERS, direction_of};
use crate::world::ProcessDirection;
use ecrt_sys::{
    EC_DIR_INPUT, EC_DIR_INVALID, EC_DIR_OUTPUT, EC_PORT_MII, EC_PORT_NOT_IMPLEMENTED,
    EC_WD_DISABLE, EC_WD_ENABLE, ec_master_info_t, ec_master_link_state_t,
    ec_master_scan_progress_t, ec_master_state_t, ec_master_t, ec_pdo_entry_info_t, ec_pdo_info_t,
    ec_slave_info_t, ec_sync_info_t,
};
use libc::{c_char, c_int, c_uint, size_t};

pub(super) unsafe extern "C" fn release_master(master: *mut ec_master_t) {
    if let Ok(call) = on_master(master) {
        call.release();
    }
}

pub(super) unsafe extern "C" fn master_info(
    master: *mut ec_master_t,
    info: *mut ec_master_info_t,
) -> c_int {
    status(on_master(master).and_then(|call| {
        let value = call.with(|State { world, master }| {
            let mut value = ec_master_info_t {
                slave_count: master.slaves.len() as c_uint,
                scan_busy: u8::from(master.scan.is_some()),
                app_time: master.clocks.app_time,
                ..Default::default()
            };
            value.set_link_up(c_uint::from(world.link_is_up()));
            value
        });
        // SAFETY: the caller passes a place for the information, or null.
        unsafe { store(info, value) }
    }))
}

pub(super) unsafe extern "C" fn master_scan_progress(
    master: *mut ec_master_t,
    progress: *mut ec_master_scan_progress_t,
) -> c_int {
    status(on_master(master).and_then(|call| {
        let value = call.with(|state| {
            let scanned = state.master.slaves.len() as c_uint;
            let total = state.master.scan.as_ref().map_or(scanned, |scan| scan.total() as c_uint);
            ec_master_scan_progress_t { slave_count: total, scan_index: scanned }
        });
        // SAFETY: the caller passes a place for the progress, or null.
        unsafe { store(progress, value) }
    }))
}

pub(super) unsafe extern "C" fn master_get_slave(
    master: *mut ec_master_t,
    position: u16,
    info: *mut ec_slave_info_t,
) -> c_int {
    status(on_master(master).and_then(|call| {
        let last = call.with(|state| state.master.slaves.len());
        let value = call.slave(position, |slave| {
            let settings = &slave.spec.settings;
            let mut value = ec_slave_info_t {
                position,
                vendor_id: settings.vendor_id,
                product_code: settings.product_code,
                revision_number: settings.revision,
                serial_number: settings.serial as u32,
                alias: slave.spec.alias,
                al_state: slave.current,
                error_flag: u8::from(slave.error_flag),
                sync_count: SYNC_MANAGERS,
                sdo_count: ecan_protocol::objects().len() as u16,
                ..Default::default()
            };
            for (to, from) in value.name.iter_mut().zip(b"ECAN-Lite\0") {
                *to = *from as c_char;
            }
            let next = position.saturating_add(1);
            for (number, port) in value.ports.iter_mut().enumerate() {
                port.desc = if number < 2 { EC_PORT_MII } else { EC_PORT_NOT_IMPLEMENTED };
                let linked = number == 0 || (number == 1 && usize::from(next) < last);
                port.link.link_up = u8::from(linked);
                port.link.signal_detected = u8::from(linked);
                port.link.loop_closed = u8::from(!linked);
                port.next_slave = match number {
                    0 if position > 0 => position - 1,
                    1 if linked => next,
                    _ => u16::MAX,
                };
            }
            Ok(value)
        })?;
        // SAFETY: the caller passes a place for the information, or null.
        unsafe { store(info, value) }
    }))
}

pub(super) unsafe extern "C" fn master_get_sync_manager(
    master: *mut ec_master_t,
    position: u16,
    sync_index: u8,
    sync: *mut ec_sync_info_t,
) -> c_int {
    status(on_master(master).and_then(|call| {
        let value = call.sync_pdos(position, sync_index, |pdos| {
            Ok(ec_sync_info_t {
                index: sync_index,
                dir: match direction_of(sync_index) {
                    Some(ProcessDirection::Output) => EC_DIR_OUTPUT,
                    Some(ProcessDirection::Input) => EC_DIR_INPUT,
                    None => EC_DIR_INVALID,
                },
                n_pdos: pdos.len() as c_uint,
                pdos: std::ptr::null_mut(),
                watchdog_mode: if sync_index == 2 { EC_WD_ENABLE } else { EC_WD_DISABLE },
            })
        })?;
        // SAFETY: the caller passes a place for the information, or null.
        unsafe { store(sync, value) }
    }))
}

pub(super) unsafe extern "C" fn master_get_pdo(
    master: *mut ec_master_t,
    position: u16,
    sync_index: u8,
    pdo_position: u16,
    pdo: *mut ec_pdo_info_t,
) -> c_int {
    status(on_master(master).and_then(|call| {
        let value = call.sync_pdos(position, sync_index, |pdos| {
            let found = pdos.get(usize::from(pdo_position)).ok_or(libc::EINVAL)?;
            Ok(ec_pdo_info_t {
                index: found.index,
                n_entries: found.entries.len() as c_uint,
                entries: std::ptr::null_mut(),
            })
        })?;
        // SAFETY: the caller passes a place for the information, or null.
        unsafe { store(pdo, value) }
    }))
}

pub(super) unsafe extern "C" fn master_get_pdo_entry(
    master: *mut ec_master_t,
    position: u16,
    sync_index: u8,
    pdo_position: u16,
    entry_position: u16,
    entry: *mut ec_pdo_entry_info_t,
) -> c_int {
    status(on_master(master).and_then(|call| {
        let value = call.sync_pdos(position, sync_index, |pdos| {
            let pdo = pdos.get(usize::from(pdo_position)).ok_or(libc::EINVAL)?;
            let found = pdo.entries.get(usize::from(entry_position)).ok_or(libc::EINVAL)?;
            Ok(ec_pdo_entry_info_t {
                index: found.index,
                subindex: found.subindex,
                bit_length: found.bits,
            })
        })?;
        // SAFETY: the caller passes a place for the information, or null.
        unsafe { store(entry, value) }
    }))
}

/// Ends a blocking transfer that failed: the abort code is told only with `EIO`.
///
/// # Safety
/// `abort_code` is null or valid for writing.
unsafe fn transfer_failed((errno, code): (c_int, u32), abort_code: *mut u32) -> c_int {
    if errno == libc::EIO {
        // SAFETY: the caller's promise. Without a place for it the code goes nowhere.
        let _ = unsafe { store(abort_code, code) };
    }
    errno
}

pub(super) unsafe extern "C" fn master_sdo_download(
    master: *mut ec_master_t,
    position: u16,
    index: u16,
    subindex: u8,
    data: *const u8,
    size: size_t,
    abort_code: *mut u32,
) -> c_int {
    status(on_master(master).and_then(|call| {
        // SAFETY: the caller passes `size` bytes, or null.
        let data = unsafe { bytes(data, size)? };
        call.transfer(position, index, subindex, Some(data)).map(drop).map_err(|failure| {
            // SAFETY: the caller passes a place for the code, or null.
            unsafe { transfer_failed(failure, abort_code) }
        })
    }))
}

pub(super) unsafe extern "C" fn master_sdo_upload(
    master: *mut ec_master_t,
    position: u16,
    index: u16,
    subindex: u8,
    target: *mut u8,
    target_size: size_t,
    result_size: *mut size_t,
    abort_code: *mut u32,
) -> c_int {
    status(on_master(master).and_then(|call| {
        let data = call.transfer(position, index, subindex, None).map_err(|failure| {
            // SAFETY: the caller passes a place for the code, or null.
            unsafe { transfer_failed(failure, abort_code) }
        })?;
        if data.len() > target_size {
            return Err(libc::EOVERFLOW);
        }
        if target.is_null() {
            return Err(libc::EFAULT);
        }
        // SAFETY: the caller passes a place for `target_size` bytes, and there are no more.
        unsafe { target.copy_from_nonoverlapping(data.as_ptr(), data.len()) };
        // SAFETY: the caller passes a place for the size, or null.
        unsafe { store(result_size, data.len()) }
    }))
}

two_forms!(master_state / master_state_silent(
    master: *const ec_master_t, state: *mut ec_master_state_t) {
    let value = on_master(master)?.with(|State { world, master }| {
        let mut value = ec_master_state_t {
            slaves_responding: master.responding,
            ..Default::default()
        };
        value.set_al_states(c_uint::from(master.al_states));
        value.set_link_up(c_uint::from(world.link_is_up()));
        value
    });
    // SAFETY: the caller passes a place for the state, or null.
    unsafe { store(state, value) }
});

pub(super) unsafe extern "C" fn master_link_state(
    master: *const ec_master_t,
    device: c_uint,
    state: *mut ec_master_link_state_t,
) -> c_int {
    status(on_master(master).and_then(|call| {
        if device != 0 {
            return Err(libc::EINVAL);
        }
        let value = call.with(|State { world, master }| {
            let mut value = ec_master_link_state_t {
                slaves_responding: master.responding,
                ..Default::default()
            };
            value.set_al_states(c_uint::from(master.al_states));
            value.set_link_up(c_uint::from(world.link_is_up()));
            value
        });
        // SAFETY: the caller passes a place for the state, or null.
        unsafe { store(state, value) }
    }))
}
