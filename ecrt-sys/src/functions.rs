//! The table of the library's functions.

use std::ffi::CString;

use libc::{c_char, c_int, c_uint, size_t};
use libloading::os::unix::Library;

use crate::bindings::{
    ec_al_state_t, ec_direction_t, ec_domain_state_t, ec_domain_t, ec_master_info_t,
    ec_master_link_state_t, ec_master_scan_progress_t, ec_master_state_t, ec_master_t,
    ec_pdo_entry_info_t, ec_pdo_info_t, ec_reg_request_t, ec_request_state_t, ec_sdo_request_t,
    ec_slave_config_state_t, ec_slave_config_t, ec_slave_info_t, ec_sync_info_t,
    ec_watchdog_mode_t,
};

/// A function that returns a status since 1.6 and nothing in 1.5.
///
/// The variant decides how it is called, so that the result of a `void` function is never
/// read.
#[derive(Clone, Copy, Debug)]
pub enum Status<Reported, Silent> {
    /// Returns 0 or a negative error number.
    Reported(Reported),
    /// Returns nothing.
    Silent(Silent),
}

/// Calls a [`Status`] function; evaluates to its status.
///
/// A function without a status discards the error of its `ioctl`, which remains in `errno`: cleared
/// before the call, it is the status. The RTDM variant of the library leaves nothing there, so that
/// its calls count as successful.
#[macro_export]
macro_rules! status {
    ($function:expr, $($argument:expr),+ $(,)?) => {
        match $function {
            $crate::Status::Reported(function) => function($($argument),+),
            $crate::Status::Silent(function) => {
                $crate::Errno::clear_last();
                function($($argument),+);
                $crate::Errno::last_as_status()
            }
        }
    };
}

macro_rules! entry_type {
    (required ($($argument:ty),*) -> $result:ty) => {
        unsafe extern "C" fn($($argument),*) -> $result
    };
    (required ($($argument:ty),*)) => {
        unsafe extern "C" fn($($argument),*)
    };
    (optional ($($argument:ty),*) -> $result:ty) => {
        Option<unsafe extern "C" fn($($argument),*) -> $result>
    };
    (status ($($argument:ty),*)) => {
        Status<unsafe extern "C" fn($($argument),*) -> c_int, unsafe extern "C" fn($($argument),*)>
    };
    (optional_status ($($argument:ty),*)) => {
        Option<entry_type!(status ($($argument),*))>
    };
}

macro_rules! table {
    ($(
        $(#[$doc:meta])*
        $kind:ident $field:ident($($argument:ident: $type:ty),*) $(-> $result:ty)?;
    )*) => {
        /// The functions of the library that the SDK uses, with the types of version 1.6.
        ///
        /// Each entry is the function `ecrt_<name>`. Opening a master is not in the table, see
        /// [`OpenMaster`](crate::OpenMaster). A table from a shared object is filled by
        /// [`Ecrt::load`](crate::Ecrt::load); a simulated library fills it itself and passes it to
        /// [`Ecrt::simulated`](crate::Ecrt::simulated).
        #[derive(Clone, Copy, Debug)]
        pub struct Functions {
            $( $(#[$doc])* pub $field: entry_type!($kind ($($type),*) $(-> $result)?), )*
        }

        /// Names of the table's functions in the library, and whether it must have them.
        pub(crate) fn table_symbols() -> impl Iterator<Item = (&'static str, bool)> {
            let kinds = [$( (concat!("ecrt_", stringify!($field)), stringify!($kind)) ),*];
            kinds.into_iter().map(|(symbol, kind)| (symbol, !kind.starts_with("optional")))
        }

        impl Functions {
            /// Looks every function up by its name, `None` if one is missing.
            ///
            /// # Safety
            ///
            /// The functions that `source` finds under these names must be libethercat's, with the
            /// return types of the release that `source` reports.
            pub(crate) unsafe fn look_up(source: &mut SymbolSource<'_>) -> Option<Self> {
                // All names are looked up before a missing one is reported: the error
                // lists every one.
                $( let $field = source.$kind(concat!("ecrt_", stringify!($field))); )*
                Some(Self { $( $field: $field?, )* })
            }
        }
    };
}

/// The kinds of functions in the table.
impl SymbolSource<'_> {
    fn find_status<R: Copy, S: Copy>(&self, symbol: &'static str) -> Option<Status<R, S>> {
        if self.reports_status {
            self.find(symbol).map(Status::Reported)
        } else {
            self.find(symbol).map(Status::Silent)
        }
    }

    fn need<F>(&mut self, symbol: &'static str, found: Option<F>) -> Option<F> {
        if found.is_none() {
            self.missing.push(symbol);
        }
        found
    }

    pub(crate) fn required<F: Copy>(&mut self, symbol: &'static str) -> Option<F> {
        self.need(symbol, self.find(symbol))
    }

    fn optional<F: Copy>(&mut self, symbol: &'static str) -> Option<Option<F>> {
        Some(self.find(symbol))
    }

    fn status<R: Copy, S: Copy>(&mut self, symbol: &'static str) -> Option<Status<R, S>> {
        self.need(symbol, self.find_status(symbol))
    }

    fn optional_status<R: Copy, S: Copy>(
        &mut self,
        symbol: &'static str,
    ) -> Option<Option<Status<R, S>>> {
        Some(self.find_status(symbol))
    }
}

/// Calls a macro with the list of the functions in [`Functions`]: documentation, kind, name without
/// `ecrt_`, arguments and result. Kinds are `required`, `optional` (absent in 1.5), and for
/// functions that return a status since 1.6 `status` and `optional_status`.
#[macro_export]
macro_rules! for_each_function {
    ($callback:ident) => {
        $callback! {
            // Masters.

            /// Releases a master and frees every handle created from it. Not real-time safe.
            required release_master(master: *mut ec_master_t);
            /// General information. May block.
            required master(master: *mut ec_master_t, info: *mut ec_master_info_t) -> c_int;
            /// Progress of the bus scan; since 1.6. May block.
            optional master_scan_progress(
                master: *mut ec_master_t, progress: *mut ec_master_scan_progress_t) -> c_int;
            /// A slave on the bus. May block.
            required master_get_slave(
                master: *mut ec_master_t, position: u16, info: *mut ec_slave_info_t) -> c_int;
            /// A sync manager of a slave on the bus. May block.
            required master_get_sync_manager(
                master: *mut ec_master_t, position: u16, sync_index: u8, sync: *mut ec_sync_info_t)
                -> c_int;
            /// A PDO that a slave on the bus assigns by default. May block.
            required master_get_pdo(
                master: *mut ec_master_t, position: u16, sync_index: u8, pdo_position: u16,
                pdo: *mut ec_pdo_info_t) -> c_int;
            /// An entry of such a PDO. May block.
            required master_get_pdo_entry(
                master: *mut ec_master_t, position: u16, sync_index: u8, pdo_position: u16,
                entry_position: u16, entry: *mut ec_pdo_entry_info_t) -> c_int;
            /// Writes an object and waits for the response. Blocks.
            required master_sdo_download(
                master: *mut ec_master_t, position: u16, index: u16, subindex: u8, data: *const u8,
                size: size_t, abort_code: *mut u32) -> c_int;
            /// Reads an object and waits for the response. Blocks.
            required master_sdo_upload(
                master: *mut ec_master_t, position: u16, index: u16, subindex: u8, target: *mut u8,
                target_size: size_t, result_size: *mut size_t, abort_code: *mut u32) -> c_int;
            /// Writes an object by Complete Access and waits for the response. Blocks.
            optional master_sdo_download_complete(
                master: *mut ec_master_t, position: u16, index: u16, data: *const u8,
                size: size_t, abort_code: *mut u32) -> c_int;
            /// State of all links. Real-time safe.
            status master_state(master: *const ec_master_t, state: *mut ec_master_state_t);
            /// State of one link. Real-time safe if the device exists.
            required master_link_state(
                master: *const ec_master_t, device: c_uint, state: *mut ec_master_link_state_t)
                -> c_int;

            // Configuration, before activation.

            /// Makes a domain. Not real-time safe.
            required master_create_domain(master: *mut ec_master_t) -> *mut ec_domain_t;
            /// Makes the configuration of a slave. Not real-time safe.
            required master_slave_config(
                master: *mut ec_master_t, alias: u16, position: u16, vendor_id: u32,
                product_code: u32) -> *mut ec_slave_config_t;
            /// Chooses the slave whose clock is the reference; NULL for the first that can. Not
            /// real-time safe.
            required master_select_reference_clock(
                master: *mut ec_master_t, config: *mut ec_slave_config_t) -> c_int;
            /// Sets the interval between sends, µs. May block.
            required master_set_send_interval(
                master: *mut ec_master_t, interval_us: size_t) -> c_int;
            /// Ends configuration, starts the operation phase. Not real-time safe.
            required master_activate(master: *mut ec_master_t) -> c_int;
            /// Ends the operation phase, frees every handle made from the master. Not real-time safe.
            status master_deactivate(master: *mut ec_master_t);
            /// Requests OP of every configured slave, also of those with the error flag. Takes the
            /// master's semaphore: may block.
            status master_reset(master: *mut ec_master_t);
            /// Direction and watchdog of a sync manager. Not real-time safe.
            required slave_config_sync_manager(
                config: *mut ec_slave_config_t, sync_index: u8, direction: ec_direction_t,
                watchdog: ec_watchdog_mode_t) -> c_int;
            /// Divider and intervals of the watchdog. Not real-time safe.
            status slave_config_watchdog(
                config: *mut ec_slave_config_t, divider: u16, intervals: u16);
            /// Adds a PDO to a sync manager's assignment. Not real-time safe.
            required slave_config_pdo_assign_add(
                config: *mut ec_slave_config_t, sync_index: u8, pdo_index: u16) -> c_int;
            /// Empties a sync manager's assignment. Not real-time safe.
            status slave_config_pdo_assign_clear(config: *mut ec_slave_config_t, sync_index: u8);
            /// Adds an entry to a PDO's mapping. Not real-time safe.
            required slave_config_pdo_mapping_add(
                config: *mut ec_slave_config_t, pdo_index: u16, entry_index: u16,
                entry_subindex: u8, entry_bits: u8) -> c_int;
            /// Empties a PDO's mapping. Not real-time safe.
            status slave_config_pdo_mapping_clear(config: *mut ec_slave_config_t, pdo_index: u16);
            /// Puts an entry into a domain; returns its byte offset. Not real-time safe.
            required slave_config_reg_pdo_entry(
                config: *mut ec_slave_config_t, entry_index: u16, entry_subindex: u8,
                domain: *mut ec_domain_t, bit_position: *mut c_uint) -> c_int;
            /// Distributed clocks of a slave. Not real-time safe.
            status slave_config_dc(
                config: *mut ec_slave_config_t, assign_activate: u16, sync0_cycle: u32,
                sync0_shift: i32, sync1_cycle: u32, sync1_shift: i32);
            /// Registers an object to be written at every start of the slave. Not real-time safe.
            required slave_config_sdo(
                config: *mut ec_slave_config_t, index: u16, subindex: u8, data: *const u8,
                size: size_t) -> c_int;
            /// Sets a named flag; since 1.5.3. Not real-time safe.
            optional slave_config_flag(
                config: *mut ec_slave_config_t, key: *const c_char, value: i32) -> c_int;
            /// Time that a state change may take; since 1.6. Not real-time safe.
            optional slave_config_state_timeout(
                config: *mut ec_slave_config_t, from: ec_al_state_t, to: ec_al_state_t,
                timeout_ms: c_uint) -> c_int;
            /// Size of the queue of CoE emergencies. Not real-time safe.
            optional slave_config_emerg_size(
                config: *mut ec_slave_config_t, elements: size_t) -> c_int;
            /// Takes an emergency, 8 bytes; `ENOENT` without one. Real-time safe.
            optional slave_config_emerg_pop(
                config: *mut ec_slave_config_t, target: *mut u8) -> c_int;
            /// State of a slave configuration. Real-time safe.
            status slave_config_state(
                config: *const ec_slave_config_t, state: *mut ec_slave_config_state_t);
            /// Creates an SDO request, executed in parallel with the cycle. Not real-time safe.
            required slave_config_create_sdo_request(
                config: *mut ec_slave_config_t, index: u16, subindex: u8, size: size_t)
                -> *mut ec_sdo_request_t;

            // Process data.

            /// Bytes of a domain; `(size_t)-1` on error. May block.
            required domain_size(domain: *const ec_domain_t) -> size_t;
            /// A domain's memory, NULL before activation.
            required domain_data(domain: *mut ec_domain_t) -> *mut u8;
            /// Evaluates the received datagrams of a domain. Real-time safe.
            status domain_process(domain: *mut ec_domain_t);
            /// Queues a domain's datagrams. Real-time safe.
            status domain_queue(domain: *mut ec_domain_t);
            /// Working counter of a domain. Real-time safe.
            status domain_state(domain: *const ec_domain_t, state: *mut ec_domain_state_t);
            /// Sends everything queued. Real-time safe.
            status master_send(master: *mut ec_master_t);
            /// Processes received frames. Real-time safe.
            status master_receive(master: *mut ec_master_t);

            // Distributed clocks.

            /// Sets the application time, ns since 2000-01-01. Real-time safe.
            status master_application_time(master: *mut ec_master_t, time_ns: u64);
            /// Queues the reference clock's correction to the application time. Real-time safe.
            status master_sync_reference_clock(master: *mut ec_master_t);
            /// Queues the reference clock's correction to a given time; since 1.5.3. Real-time safe.
            optional_status master_sync_reference_clock_to(master: *mut ec_master_t, time_ns: u64);
            /// Queues the other clocks' correction. Real-time safe.
            status master_sync_slave_clocks(master: *mut ec_master_t);
            /// Reads the reference clock's lower half, as of the last exchange. Real-time safe, but
            /// writes to stderr when that exchange was lost.
            required master_reference_clock_time(
                master: *mut ec_master_t, time_ns: *mut u32) -> c_int;
            /// Queues the measurement of the clocks' difference. Real-time safe.
            status master_sync_monitor_queue(master: *mut ec_master_t);
            /// Largest difference of the clocks, ns; 0xffffffff if it is unknown. Real-time safe,
            /// but may write to stderr.
            required master_sync_monitor_process(master: *mut ec_master_t) -> u32;

            // SDO requests.

            /// Points a request at another object. Real-time safe.
            status sdo_request_index(request: *mut ec_sdo_request_t, index: u16, subindex: u8);
            /// Time that a request may take, ms. Real-time safe.
            status sdo_request_timeout(request: *mut ec_sdo_request_t, timeout_ms: u32);
            /// A request's memory. Real-time safe.
            required sdo_request_data(request: *mut ec_sdo_request_t) -> *mut u8;
            /// Bytes that a request holds. Real-time safe.
            required sdo_request_data_size(request: *const ec_sdo_request_t) -> size_t;
            /// State of a request; fetches the data of a finished read. Real-time safe.
            required sdo_request_state(request: *mut ec_sdo_request_t) -> ec_request_state_t;
            /// Starts a write. Real-time safe.
            status sdo_request_write(request: *mut ec_sdo_request_t);
            /// Starts a read. Real-time safe.
            status sdo_request_read(request: *mut ec_sdo_request_t);

            // Register requests.

            /// Creates a register request, executed in parallel with the cycle. Not real-time safe.
            required slave_config_create_reg_request(
                config: *mut ec_slave_config_t, size: size_t) -> *mut ec_reg_request_t;
            /// A request's memory. Real-time safe.
            required reg_request_data(request: *mut ec_reg_request_t) -> *mut u8;
            /// State of a request; fetches the data of a finished read. Real-time safe.
            required reg_request_state(request: *mut ec_reg_request_t) -> ec_request_state_t;
            /// Starts a read. Real-time safe.
            status reg_request_read(request: *mut ec_reg_request_t, address: u16, size: size_t);
            /// Starts a write of the request's memory. Real-time safe.
            status reg_request_write(request: *mut ec_reg_request_t, address: u16, size: size_t);
        }
    };
}

for_each_function!(table);

/// A library whose functions are looked up.
pub(crate) struct SymbolSource<'a> {
    pub(crate) library: &'a Library,
    /// True if functions that return nothing in 1.5 return a status.
    pub(crate) reports_status: bool,
    /// Required names that the library lacks.
    pub(crate) missing: Vec<&'static str>,
}

impl SymbolSource<'_> {
    pub(crate) fn find<F: Copy>(&self, symbol: &'static str) -> Option<F> {
        let name = CString::new(symbol).ok()?;
        // SAFETY: the symbol is read as an optional function pointer, for which null is a
        // value. That it has the type F is the promise of `Functions::look_up`'s caller.
        let found = unsafe { self.library.get::<Option<F>>(name.as_bytes_with_nul()) };
        found.ok().and_then(|function| *function)
    }
}
