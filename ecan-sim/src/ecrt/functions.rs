//! The edge to C: the table of functions, with pointers on one side and checked calls on the other.
//!
//! The only place of this crate with `unsafe`. Handles are never dereferenced (see the registry);
//! what is dereferenced are the caller's own out-parameters and buffers, which libethercat's
//! interface obliges it to pass valid or null.

use std::slice;
use std::sync::Arc;

use ecrt_sys::{
    EC_DIR_INPUT, EC_DIR_INVALID, EC_DIR_OUTPUT, EC_PORT_MII, EC_PORT_NOT_IMPLEMENTED,
    EC_REQUEST_BUSY, EC_REQUEST_ERROR, EC_REQUEST_SUCCESS, EC_REQUEST_UNUSED, EC_WC_COMPLETE,
    EC_WC_INCOMPLETE, EC_WC_ZERO, EC_WD_DEFAULT, EC_WD_DISABLE, EC_WD_ENABLE, Ecrt, Errno, Functions,
    OpenMaster, Status, ec_al_state_t, ec_direction_t, ec_domain_state_t, ec_domain_t,
    ec_master_info_t, ec_master_link_state_t, ec_master_scan_progress_t, ec_master_state_t,
    ec_master_t, ec_pdo_entry_info_t, ec_pdo_info_t, ec_reg_request_t, ec_request_state_t,
    ec_sdo_request_t, ec_slave_config_state_t, ec_slave_config_t, ec_slave_info_t, ec_sync_info_t,
    ec_watchdog_mode_t,
};
use libc::{c_char, c_int, c_uint, size_t};

use crate::ecrt::calls::{
    Answer, ConfigCall, DomainCall, MasterCall, RegRequestCall, RequestCall,
};
use crate::ecrt::front::{Shared, State};
use crate::ecrt::registry::{self, Handle, Target};
use crate::ecrt::slave_config::{DcConfig, RequestProgress, SyncWatchdog};
use crate::ecrt::slave_view::{PdoEntry, SYNC_MANAGERS, direction_of};
use crate::ecrt::transport::Queued;
use crate::scenario::EcrtVersion;
use crate::simulation::Simulation;
use crate::world::ProcessDirection;

/// Whether the kernel started this program with more rights than its user has.
pub(crate) fn secure_execution() -> bool {
    // SAFETY: getauxval only reads the process's auxiliary vector.
    unsafe { libc::getauxval(libc::AT_SECURE) != 0 }
}

/// The library in front of a simulation.
pub(crate) fn simulated_library(simulation: &Simulation) -> Ecrt {
    let shared = simulation.shared().clone();
    let version = shared.version();
    let masters = Arc::new(SimulatedLibrary { shared });
    let scenario = simulation.scenario_name();
    let clock = Arc::new(simulation.clock());
    // SAFETY: every entry of the table behaves as libethercat's function of that name: it takes
    // only handles that it gave out, and touches only its own memory and what its caller passes.
    unsafe { Ecrt::simulated(table(version), masters, version.magic(), scenario, clock) }
}

/// Opens masters of one simulated world.
struct SimulatedLibrary {
    shared: Arc<Shared>,
}

impl SimulatedLibrary {
    fn handle(&self, client: u64) -> *mut ec_master_t {
        let shared = self.shared.clone();
        pointer(registry::insert(Handle { shared, client, target: Target::Master }))
    }
}

impl OpenMaster for SimulatedLibrary {
    fn request(&self, index: u32) -> *mut ec_master_t {
        if index != 0 {
            return null_with(libc::ENOENT);
        }
        match self.shared.request() {
            Ok(client) => self.handle(client),
            Err(errno) => null_with(errno),
        }
    }

    fn open(&self, index: u32) -> *mut ec_master_t {
        if index != 0 {
            return null_with(libc::ENOENT);
        }
        let client = self.shared.with(|state| state.master.new_client());
        self.handle(client)
    }
}

/// A handle's number as the pointer that the caller gets.
fn pointer<T>(address: usize) -> *mut T {
    std::ptr::without_provenance_mut(address)
}

fn null_with<T>(errno: c_int) -> *mut T {
    Errno::new(errno).set_last();
    std::ptr::null_mut()
}

/// What a call returns that reports a status.
fn status(answer: Answer) -> c_int {
    match answer {
        Ok(()) => 0,
        Err(errno) => -errno,
    }
}

fn handle_or_null<T>(answer: Answer<usize>) -> *mut T {
    match answer {
        Ok(address) => pointer(address),
        Err(errno) => null_with(errno),
    }
}

/// Stores a result where the caller wants it.
///
/// # Safety
/// `target` is null or valid for writing.
unsafe fn store<T>(target: *mut T, value: T) -> Answer {
    if target.is_null() {
        return Err(libc::EFAULT);
    }
    // SAFETY: not null, so valid for writing by the caller's promise.
    unsafe { target.write(value) };
    Ok(())
}

/// Copies the caller's data.
///
/// # Safety
/// `data` is null or valid for reading `size` bytes.
unsafe fn bytes(data: *const u8, size: size_t) -> Answer<Vec<u8>> {
    if data.is_null() || size == 0 || size > isize::MAX as usize {
        return Err(libc::EINVAL);
    }
    // SAFETY: not null, so valid for reading by the caller's promise.
    Ok(unsafe { slice::from_raw_parts(data, size) }.to_vec())
}

fn on_master(master: *const ec_master_t) -> Answer<MasterCall> {
    MasterCall::find(master.addr())
}

fn on_config(config: *const ec_slave_config_t) -> Answer<ConfigCall> {
    ConfigCall::find(config.addr())
}

fn on_domain(domain: *const ec_domain_t) -> Answer<DomainCall> {
    DomainCall::find(domain.addr())
}

fn on_request(request: *const ec_sdo_request_t) -> Answer<RequestCall> {
    RequestCall::find(request.addr())
}

fn on_reg_request(request: *const ec_reg_request_t) -> Answer<RegRequestCall> {
    RegRequestCall::find(request.addr())
}

/// A function in both of its forms: 1.6 returns a status, 1.5 returned nothing.
macro_rules! two_forms {
    ($reported:ident / $silent:ident ($($argument:ident: $type:ty),*) $body:block) => {
        unsafe extern "C" fn $reported($($argument: $type),*) -> c_int {
            status((|| -> Answer { $body })())
        }
        unsafe extern "C" fn $silent($($argument: $type),*) {
            // SAFETY: the same arguments under the same promises.
            let _ = unsafe { $reported($($argument),*) };
        }
    };
}

unsafe extern "C" fn release_master(master: *mut ec_master_t) {
    if let Ok(call) = on_master(master) {
        call.release();
    }
}

unsafe extern "C" fn master_info(master: *mut ec_master_t, info: *mut ec_master_info_t) -> c_int {
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

unsafe extern "C" fn master_scan_progress(
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

unsafe extern "C" fn master_get_slave(
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

unsafe extern "C" fn master_get_sync_manager(
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

unsafe extern "C" fn master_get_pdo(
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

unsafe extern "C" fn master_get_pdo_entry(
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

unsafe extern "C" fn master_sdo_download(
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

unsafe extern "C" fn master_sdo_upload(
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

unsafe extern "C" fn master_link_state(
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

unsafe extern "C" fn master_create_domain(master: *mut ec_master_t) -> *mut ec_domain_t {
    handle_or_null(on_master(master).and_then(|call| call.create_domain()))
}

unsafe extern "C" fn master_slave_config(
    master: *mut ec_master_t,
    alias: u16,
    position: u16,
    vendor_id: u32,
    product_code: u32,
) -> *mut ec_slave_config_t {
    handle_or_null(
        on_master(master)
            .and_then(|call| call.slave_config(alias, position, vendor_id, product_code)),
    )
}

unsafe extern "C" fn master_select_reference_clock(
    master: *mut ec_master_t,
    config: *mut ec_slave_config_t,
) -> c_int {
    status(on_master(master).and_then(|call| {
        if !config.is_null() {
            on_config(config)?;
        }
        // The clocks do not drift: whichever is the reference, the others agree with it.
        call.driving(|_| ())
    }))
}

unsafe extern "C" fn master_set_send_interval(
    master: *mut ec_master_t,
    interval_us: size_t,
) -> c_int {
    status(on_master(master).and_then(|call| {
        if interval_us == 0 {
            return Err(libc::EINVAL);
        }
        call.driving(|_| ())
    }))
}

unsafe extern "C" fn master_activate(master: *mut ec_master_t) -> c_int {
    status(on_master(master).and_then(|call| call.activate()))
}

two_forms!(master_deactivate / master_deactivate_silent(master: *mut ec_master_t) {
    on_master(master)?.deactivate()
});

unsafe extern "C" fn slave_config_sync_manager(
    config: *mut ec_slave_config_t,
    sync_index: u8,
    direction: ec_direction_t,
    watchdog: ec_watchdog_mode_t,
) -> c_int {
    status(on_config(config).and_then(|call| {
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
    }))
}

two_forms!(slave_config_watchdog / slave_config_watchdog_silent(
    config: *mut ec_slave_config_t, divider: u16, intervals: u16) {
    on_config(config)?.change(|config| {
        config.watchdog = (divider, intervals);
        Ok(())
    })
});

unsafe extern "C" fn slave_config_pdo_assign_add(
    config: *mut ec_slave_config_t,
    sync_index: u8,
    pdo_index: u16,
) -> c_int {
    status(on_config(config).and_then(|call| call.assign_pdo(sync_index, pdo_index)))
}

two_forms!(slave_config_pdo_assign_clear / slave_config_pdo_assign_clear_silent(
    config: *mut ec_slave_config_t, sync_index: u8) {
    on_config(config)?.change_sync(sync_index, |sync| {
        sync.pdos.clear();
        Ok(())
    })
});

unsafe extern "C" fn slave_config_pdo_mapping_add(
    config: *mut ec_slave_config_t,
    pdo_index: u16,
    entry_index: u16,
    entry_subindex: u8,
    entry_bits: u8,
) -> c_int {
    status(on_config(config).and_then(|call| {
        let entry = PdoEntry { index: entry_index, subindex: entry_subindex, bits: entry_bits };
        call.change(|config| {
            if config.add_entry(pdo_index, entry) { Ok(()) } else { Err(libc::ENOENT) }
        })
    }))
}

two_forms!(slave_config_pdo_mapping_clear / slave_config_pdo_mapping_clear_silent(
    config: *mut ec_slave_config_t, pdo_index: u16) {
    on_config(config)?.change(|config| {
        if let Some(pdo) = config.find_pdo(pdo_index) {
            pdo.entries.clear();
        }
        Ok(())
    })
});

unsafe extern "C" fn slave_config_reg_pdo_entry(
    config: *mut ec_slave_config_t,
    entry_index: u16,
    entry_subindex: u8,
    domain: *mut ec_domain_t,
    bit_position: *mut c_uint,
) -> c_int {
    let answer = on_config(config).and_then(|call| {
        let domain = on_domain(domain)?;
        if !call.is_beside(&domain) {
            return Err(libc::ENOENT);
        }
        let (byte, bit) = call.register_entry(entry_index, entry_subindex, &domain)?;
        if bit_position.is_null() && bit != 0 {
            return Err(libc::EFAULT);
        }
        // SAFETY: the caller passes a place for the bit position, or null.
        let _ = unsafe { store(bit_position, bit) };
        c_int::try_from(byte).map_err(|_| libc::EOVERFLOW)
    });
    answer.unwrap_or_else(|errno| -errno)
}

two_forms!(slave_config_dc / slave_config_dc_silent(
    config: *mut ec_slave_config_t, assign_activate: u16, sync0_cycle: u32, sync0_shift: i32,
    sync1_cycle: u32, _sync1_shift: i32) {
    on_config(config)?.change(|config| {
        config.dc = Some(DcConfig { assign_activate, sync0_cycle, sync0_shift, sync1_cycle });
        Ok(())
    })
});

unsafe extern "C" fn slave_config_sdo(
    config: *mut ec_slave_config_t,
    index: u16,
    subindex: u8,
    data: *const u8,
    size: size_t,
) -> c_int {
    status(on_config(config).and_then(|call| {
        // SAFETY: the caller passes `size` bytes, or null.
        call.add_sdo(index, subindex, unsafe { bytes(data, size)? })
    }))
}

unsafe extern "C" fn slave_config_flag(
    config: *mut ec_slave_config_t,
    key: *const c_char,
    _value: i32,
) -> c_int {
    // Flags change nothing that is simulated.
    status(on_config(config).and_then(|call| {
        if key.is_null() { Err(libc::EFAULT) } else { call.change(|_| Ok(())) }
    }))
}

unsafe extern "C" fn slave_config_state_timeout(
    config: *mut ec_slave_config_t,
    from: ec_al_state_t,
    to: ec_al_state_t,
    timeout_ms: c_uint,
) -> c_int {
    status(on_config(config).and_then(|call| {
        let state = |state: ec_al_state_t| u8::try_from(state).map_err(|_| libc::EINVAL);
        let limit = (state(from)?, state(to)?, u64::from(timeout_ms) * 1_000_000);
        call.change(|config| {
            config.state_timeouts.push(limit);
            Ok(())
        })
    }))
}

two_forms!(slave_config_state / slave_config_state_silent(
    config: *const ec_slave_config_t, state: *mut ec_slave_config_state_t) {
    let (slave, operational) = on_config(config)?.state()?;
    let mut value = ec_slave_config_state_t::default();
    value.set_online(c_uint::from(slave.online));
    value.set_operational(c_uint::from(operational));
    value.set_al_state(c_uint::from(slave.al_state));
    // SAFETY: the caller passes a place for the state, or null.
    unsafe { store(state, value) }
});

unsafe extern "C" fn slave_config_create_sdo_request(
    config: *mut ec_slave_config_t,
    index: u16,
    subindex: u8,
    size: size_t,
) -> *mut ec_sdo_request_t {
    handle_or_null(
        on_config(config).and_then(|call| call.create_sdo_request(index, subindex, size)),
    )
}

unsafe extern "C" fn domain_size(domain: *const ec_domain_t) -> size_t {
    on_domain(domain).and_then(|call| call.size()).unwrap_or(size_t::MAX)
}

unsafe extern "C" fn domain_data(domain: *mut ec_domain_t) -> *mut u8 {
    match on_domain(domain).and_then(|call| call.memory()) {
        Ok(memory) => memory.as_ptr(),
        Err(errno) => null_with(errno),
    }
}

two_forms!(domain_process / domain_process_silent(domain: *mut ec_domain_t) {
    on_domain(domain)?.process()
});

two_forms!(domain_queue / domain_queue_silent(domain: *mut ec_domain_t) {
    on_domain(domain)?.queue()
});

two_forms!(domain_state / domain_state_silent(
    domain: *const ec_domain_t, state: *mut ec_domain_state_t) {
    let (counter, expected) = on_domain(domain)?.counters()?;
    let value = ec_domain_state_t {
        working_counter: counter,
        wc_state: match counter {
            0 => EC_WC_ZERO,
            counter if counter == expected => EC_WC_COMPLETE,
            _ => EC_WC_INCOMPLETE,
        },
        redundancy_active: 0,
    };
    // SAFETY: the caller passes a place for the state, or null.
    unsafe { store(state, value) }
});

two_forms!(master_send / master_send_silent(master: *mut ec_master_t) {
    on_master(master)?.send()
});

two_forms!(master_receive / master_receive_silent(master: *mut ec_master_t) {
    on_master(master)?.receive()
});

two_forms!(master_application_time / master_application_time_silent(
    master: *mut ec_master_t, time_ns: u64) {
    on_master(master)?.driving(|state| state.master.clocks.application_time(time_ns))
});

two_forms!(master_sync_reference_clock / master_sync_reference_clock_silent(
    master: *mut ec_master_t) {
    on_master(master)?.queue_clock(Queued::ReferenceClock, None)
});

two_forms!(master_sync_reference_clock_to / master_sync_reference_clock_to_silent(
    master: *mut ec_master_t, time_ns: u64) {
    on_master(master)?.queue_clock(Queued::ReferenceClock, Some(time_ns))
});

two_forms!(master_sync_slave_clocks / master_sync_slave_clocks_silent(
    master: *mut ec_master_t) {
    on_master(master)?.queue_clock(Queued::SlaveClocks, None)
});

unsafe extern "C" fn master_reference_clock_time(
    master: *mut ec_master_t,
    time_ns: *mut u32,
) -> c_int {
    status(on_master(master).and_then(|call| {
        let value = call.reference_clock_time()?;
        // SAFETY: the caller passes a place for the time, or null.
        unsafe { store(time_ns, value) }
    }))
}

two_forms!(master_sync_monitor_queue / master_sync_monitor_queue_silent(
    master: *mut ec_master_t) {
    on_master(master)?.queue_clock(Queued::ClockMonitor, None)
});

unsafe extern "C" fn master_sync_monitor_process(master: *mut ec_master_t) -> u32 {
    on_master(master).and_then(|call| call.sync_monitor()).unwrap_or(u32::MAX)
}

two_forms!(sdo_request_index / sdo_request_index_silent(
    request: *mut ec_sdo_request_t, index: u16, subindex: u8) {
    on_request(request)?.change(|request| {
        (request.index, request.subindex) = (index, subindex);
    })
});

two_forms!(sdo_request_timeout / sdo_request_timeout_silent(
    request: *mut ec_sdo_request_t, timeout_ms: u32) {
    on_request(request)?.change(|request| {
        request.timeout_ns = u64::from(timeout_ms) * 1_000_000;
    })
});

unsafe extern "C" fn sdo_request_data(request: *mut ec_sdo_request_t) -> *mut u8 {
    match on_request(request).and_then(|call| call.change(|request| request.memory.as_ptr())) {
        Ok(data) => data,
        Err(errno) => null_with(errno),
    }
}

unsafe extern "C" fn sdo_request_data_size(request: *const ec_sdo_request_t) -> size_t {
    on_request(request).and_then(|call| call.change(|request| request.data_size)).unwrap_or(0)
}

fn request_state(progress: RequestProgress) -> ec_request_state_t {
    match progress {
        RequestProgress::Unused => EC_REQUEST_UNUSED,
        RequestProgress::Queued | RequestProgress::Busy => EC_REQUEST_BUSY,
        RequestProgress::Success => EC_REQUEST_SUCCESS,
        RequestProgress::Failure => EC_REQUEST_ERROR,
    }
}

unsafe extern "C" fn sdo_request_state(request: *mut ec_sdo_request_t) -> ec_request_state_t {
    on_request(request).and_then(|call| call.progress()).map_or(EC_REQUEST_ERROR, request_state)
}

two_forms!(sdo_request_write / sdo_request_write_silent(request: *mut ec_sdo_request_t) {
    on_request(request)?.start(true)
});

two_forms!(sdo_request_read / sdo_request_read_silent(request: *mut ec_sdo_request_t) {
    on_request(request)?.start(false)
});

unsafe extern "C" fn slave_config_create_reg_request(
    config: *mut ec_slave_config_t,
    size: size_t,
) -> *mut ec_reg_request_t {
    handle_or_null(on_config(config).and_then(|call| call.create_reg_request(size)))
}

unsafe extern "C" fn reg_request_data(request: *mut ec_reg_request_t) -> *mut u8 {
    match on_reg_request(request).and_then(|call| call.change(|request| request.memory.as_ptr())) {
        Ok(data) => data,
        Err(errno) => null_with(errno),
    }
}

unsafe extern "C" fn reg_request_state(request: *mut ec_reg_request_t) -> ec_request_state_t {
    on_reg_request(request)
        .and_then(|call| call.change(|request| request.fetch()))
        .map_or(EC_REQUEST_ERROR, request_state)
}

two_forms!(reg_request_read / reg_request_read_silent(
    request: *mut ec_reg_request_t, address: u16, size: size_t) {
    on_reg_request(request)?.read(address, size)
});

/// The table of a simulated release.
fn table(version: EcrtVersion) -> Functions {
    let new = version != EcrtVersion::V1_5;
    /// The form of a function that the release has.
    macro_rules! form {
        ($reported:ident / $silent:ident) => {
            if new { Status::Reported($reported) } else { Status::Silent($silent) }
        };
    }
    Functions {
        release_master,
        master: master_info,
        master_scan_progress: new.then_some(master_scan_progress),
        master_get_slave,
        master_get_sync_manager,
        master_get_pdo,
        master_get_pdo_entry,
        master_sdo_download,
        master_sdo_upload,
        master_state: form!(master_state / master_state_silent),
        master_link_state,
        master_create_domain,
        master_slave_config,
        master_select_reference_clock,
        master_set_send_interval,
        master_activate,
        master_deactivate: form!(master_deactivate / master_deactivate_silent),
        slave_config_sync_manager,
        slave_config_watchdog: form!(slave_config_watchdog / slave_config_watchdog_silent),
        slave_config_pdo_assign_add,
        slave_config_pdo_assign_clear: form!(
            slave_config_pdo_assign_clear / slave_config_pdo_assign_clear_silent
        ),
        slave_config_pdo_mapping_add,
        slave_config_pdo_mapping_clear: form!(
            slave_config_pdo_mapping_clear / slave_config_pdo_mapping_clear_silent
        ),
        slave_config_reg_pdo_entry,
        slave_config_dc: form!(slave_config_dc / slave_config_dc_silent),
        slave_config_sdo,
        slave_config_flag: new.then_some(slave_config_flag),
        slave_config_state_timeout: new.then_some(slave_config_state_timeout),
        slave_config_state: form!(slave_config_state / slave_config_state_silent),
        slave_config_create_sdo_request,
        domain_size,
        domain_data,
        domain_process: form!(domain_process / domain_process_silent),
        domain_queue: form!(domain_queue / domain_queue_silent),
        domain_state: form!(domain_state / domain_state_silent),
        master_send: form!(master_send / master_send_silent),
        master_receive: form!(master_receive / master_receive_silent),
        master_application_time: form!(master_application_time / master_application_time_silent),
        master_sync_reference_clock: form!(
            master_sync_reference_clock / master_sync_reference_clock_silent
        ),
        master_sync_reference_clock_to: new.then_some(form!(
            master_sync_reference_clock_to / master_sync_reference_clock_to_silent
        )),
        master_sync_slave_clocks: form!(
            master_sync_slave_clocks / master_sync_slave_clocks_silent
        ),
        master_reference_clock_time,
        master_sync_monitor_queue: form!(
            master_sync_monitor_queue / master_sync_monitor_queue_silent
        ),
        master_sync_monitor_process,
        sdo_request_index: form!(sdo_request_index / sdo_request_index_silent),
        sdo_request_timeout: form!(sdo_request_timeout / sdo_request_timeout_silent),
        sdo_request_data,
        sdo_request_data_size,
        sdo_request_state,
        sdo_request_write: form!(sdo_request_write / sdo_request_write_silent),
        sdo_request_read: form!(sdo_request_read / sdo_request_read_silent),
        slave_config_create_reg_request,
        reg_request_data,
        reg_request_state,
        reg_request_read: form!(reg_request_read / reg_request_read_silent),
    }
}
