//! Configuration from a file
//!
//! One TOML file describes the gateways of a bus: their positions, PDO sizes, distributed clocks,
//! channels with bit rates, filters and policies. `ecan config example` prints one with every key;
//! `ecan config` also checks, compares and exports the file that an application loads.
//!
//! ```c
//! ecan_open(&igh, &mcan, "cell.toml");                  master and gateways, ready for frames
//! igh_cia402_context_init_file(&axes, &mcan, "cell.toml", NULL);
//! ```
//!
//! An application that changes what it loads takes the steps of this call one by one:
//!
//! ```c
//! ecan_igh_default_config(&igh_config);
//! if (igh_mcan_port_load_config(&igh_config, &mcan_config, "cell.toml", NULL, 0, NULL) != ECAN_OK) {
//!     fprintf(stderr, "%s\n", ecan_last_error());    every fault, with line and column
//! }
//! ecan_igh_init(&igh, &igh_config);
//! igh_mcan_port_init(&mcan, &igh, &mcan_config);
//! ```

use std::ffi::{CStr, OsStr, c_char};
use std::os::unix::ffi::OsStrExt;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, OutArray, OutPointer, pointers};
use ecan_c_export::export;
use ecan_lite::config::{ConfigFileError, FileFault, FileFaults};
use ecan_mcan_port::Config;

use super::config::igh_mcan_port_config_t;
use crate::adapter::config::{ecan_igh_config_t, extended_port};
use crate::encoded::{EncodedCall as _, EncodedMut};
use crate::errors;

/// Bytes of the text of a fault, NUL included.
pub const IGH_MCAN_FILE_FAULT_BYTES: usize = 248;

/// A fault of a configuration file.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_file_fault_t {
    /// Line, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
    /// Reason, in UTF-8; cut if it does not fit.
    pub reason: [c_char; IGH_MCAN_FILE_FAULT_BYTES],
    /// Zero; for fields of later versions.
    pub reserved: [u32; 6],
}

impl From<&FileFault> for igh_mcan_file_fault_t {
    fn from(fault: &FileFault) -> Self {
        let mut reason = [0; IGH_MCAN_FILE_FAULT_BYTES];
        let mut length = fault.reason.len().min(reason.len() - 1);
        while !fault.reason.is_char_boundary(length) {
            length -= 1;
        }
        for (place, byte) in reason.iter_mut().zip(&fault.reason.as_bytes()[..length]) {
            *place = *byte as c_char;
        }
        let number = |number| u32::try_from(number).unwrap_or(u32::MAX);
        Self { line: number(fault.line), column: number(fault.column), reason, reserved: [0; 6] }
    }
}

/// The faults of a file, for C.
struct FaultList {
    faults: OutArray<igh_mcan_file_fault_t>,
    count: Option<OutPointer<usize>>,
}

impl FaultList {
    fn new(faults: OutArray<igh_mcan_file_fault_t>, count: Option<OutPointer<usize>>) -> Self {
        let this = Self { faults, count };
        this.set_count(0);
        this
    }

    fn set_count(&self, found: usize) {
        if let Some(count) = &self.count {
            count.set(found);
        }
    }

    fn put(&mut self, FileFaults(found): &FileFaults) {
        self.set_count(found.len());
        found.iter().take_while(|fault| self.faults.push((*fault).into())).for_each(drop);
    }
}

/// Stores a file's configuration in both C structs. It is also applied, so that nothing of the file
/// is missing if an application does not apply it.
fn store(
    call: Call,
    file: &Config,
    mut igh_config: EncodedMut<ecan_igh_config_t>,
    config: &OutPointer<igh_mcan_port_config_t>,
) -> Result<(), ecan_result_t> {
    let port = extended_port(&file.port);
    *igh_config.value = igh_config.value.with(&file.adapter, port);
    igh_config.store(call)?;
    call.encode(config, &port)
}

pub(super) fn load(path: &CStr) -> Result<Config, ConfigFileError> {
    ecan_lite::config::load(OsStr::from_bytes(path.to_bytes()))
}

/// Loads the configurations of the Adapter and of the Port from a file. They are applied, as by
/// igh_mcan_port_apply_config(): ecan_igh_init() and igh_mcan_port_init() are all that is left.
///
/// Everything in the file reaches the gateways, and keys that it does not have get the file's
/// defaults, for any previous content. Other functions may change both afterwards; apply changes of
/// `config` again.
///
/// @param igh_config  Initialised. Settings that a file does not have stay: the library (setting
///                    `ecrt`), scenario, clock and seed of a simulation. Everything else is
///                    replaced, startup SDOs included. Policies of 0x8020 become startup SDOs, 6
///                    per gateway with policies, and count for ECAN_IGH_MAX_STARTUP_SDOS.
/// @param config      Is overwritten.
/// @param path        Path of the file, relative to the working directory; "-" is standard input.
/// @param faults      Gets the faults that fit, in the order of the lines, for an editor for example;
///                    may be NULL if capacity is 0. ecan_last_error() holds some eighty of them.
/// @param capacity    Size of `faults`.
/// @param count       Gets the number of all faults, 0 for every other error; may be NULL.
///
/// @usage   not rt, any thread, before ecan_igh_init or igh_mcan_port_reconfigure
/// @return  ECAN_OK; ECAN_ERR_FILE if it cannot be read; ECAN_ERR_CONFIG with every fault in
///          ecan_last_error(), by line and column, also for more than ECAN_IGH_MAX_SLAVES gateways
///          or IGH_MCAN_MAX_FILTERS filters. An error changes neither configuration.
#[must_use]
#[export(call)]
pub fn igh_mcan_port_load_config(
    igh_config: *mut ecan_igh_config_t,
    config: *mut igh_mcan_port_config_t,
    path: *const c_char,
    faults: *mut igh_mcan_file_fault_t,
    capacity: usize,
    count: *mut usize,
) {
    pointers!(call, optional_out(count), room(faults, capacity));
    let mut faults = FaultList::new(faults, count);
    pointers!(call, encoded_mut(igh_config), out(config), c_str(path));
    let file = load(path).map_err(|error| {
        if let ConfigFileError::Faults { faults: found, .. } = &error {
            faults.put(found);
        }
        errors::note(call, &error)
    })?;
    store(call, &file, igh_config, &config)
}

/// As igh_mcan_port_load_config(), from a text in memory.
///
/// @param text  Content of the file, up to a NUL.
///
/// @usage   not rt, any thread, before ecan_igh_init or igh_mcan_port_reconfigure
/// @return  As igh_mcan_port_load_config(), except ECAN_ERR_FILE.
#[must_use]
#[export(call)]
pub fn igh_mcan_port_parse_config(
    igh_config: *mut ecan_igh_config_t,
    config: *mut igh_mcan_port_config_t,
    text: *const c_char,
    faults: *mut igh_mcan_file_fault_t,
    capacity: usize,
    count: *mut usize,
) {
    pointers!(call, optional_out(count), room(faults, capacity));
    let mut faults = FaultList::new(faults, count);
    pointers!(call, encoded_mut(igh_config), out(config), c_str(text));
    let file = ecan_lite::config::parse(text.to_bytes()).map_err(|found| {
        faults.put(&found);
        call.fail(ecan_result_t::ECAN_ERR_CONFIG, format_args!("{found}"))
    })?;
    store(call, &file, igh_config, &config)
}

#[cfg(test)]
mod tests {
    use std::ffi::c_int;
    use std::mem::MaybeUninit;
    use std::ptr::null_mut;

    use ecan_c_boundary::call;
    use ecan_host::AdapterConfig;
    use ecan_lite::config::EXAMPLE;
    use ecan_mcan_port::PortConfig;

    use super::*;
    use crate::adapter::config::{
        configured_port, ecan_igh_config_set_ecrt, ecan_igh_default_config,
    };
    use crate::adapter::context::ecan_igh_config_set_seed;

    /// Values that the example leaves at a default.
    const OTHER_VALUES: &str = r#"
        master = 1
        cycle_us = 250.5
        allow_large_pdos = true
        preop_timeout_ms = 500
        watchdog_us = 20_000
        [dc]
        cycle_us = 501
        shift_us = 100
        assign_activate = 0x0700
        source = "reference"
        reference = 1
        monitor_every = 0
        [[gateway]]
        alias = 7
        rx_pdo = { n = 2, profile = 4, budget = "deterministic", options = ["align4"] }
        tx_pdo = { n = 13, profile = 5, budget = "shared_only", options = ["tx_result"] }
        paced = false
        hold_limit = 3
        input_limit = 0
        allow_diagnostic_tests = true
        schedule = { latest_send_us = 20, margin_check = "reject", discard_missed = false }
        data_path = { max_service_budget_us = 700 }
        [gateway.can3]
        bitrate = 250_000
        sample_point = [80, 87.5]
        node_mode = "listen"
        non_match_extended = "reject"
        ram = { layout = "fd", rx_fifo0_size = 10, rx_fifo1_data_bytes = 12 }
        data_path = { rx_drain_max = 5, rx_cache_depth = 24, bus_off_recovery = "manual" }
        traffic = { received = 3, sent = 2 }
        standard_filter = [
            { match = "two", action = "reject", id1 = 3, id2 = 4, sync = true },
            { action = "rx_buffer", rx_buffer = 2, id1 = 5 },
        ]
        extended_filter = [
            { match = "range_unmasked", action = "priority_fifo1", id1 = 1, id2 = 2, sync = true },
        ]
        [[gateway]]
        n = 1
        identity = { vendor_id = 1, product_code = 2 }
        data_path = { compat_mode = 3 }
        [gateway.can0]
        bitrate = 500_000
        bit_timing = "manual"
        nominal_timing = { brp = 2, tseg1 = 63, tseg2 = 16, sjw = 16 }
        [[gateway.can0.standard_filter]]
        match = "masked"
        action = "fifo1"
        id1 = 0x100
        id2 = 0x700
    "#;

    /// The configurations as C holds them.
    struct Configurations {
        adapter: Box<MaybeUninit<ecan_igh_config_t>>,
        port: Box<MaybeUninit<igh_mcan_port_config_t>>,
    }

    impl Configurations {
        fn new() -> Self {
            let mut this = Self { adapter: Box::new_uninit(), port: Box::new_uninit() };
            // SAFETY: the pointer is valid.
            assert_eq!(unsafe { ecan_igh_default_config(this.adapter.as_mut_ptr()) }, 0);
            this
        }

        fn parse(&mut self, text: &str) -> c_int {
            let text = std::ffi::CString::new(text).unwrap();
            let (adapter, port) = (self.adapter.as_mut_ptr(), self.port.as_mut_ptr());
            let mut count = 0;
            // SAFETY: every pointer is valid; there is no room for faults.
            unsafe {
                igh_mcan_port_parse_config(
                    adapter,
                    port,
                    text.as_ptr(),
                    null_mut(),
                    0,
                    &raw mut count,
                )
            }
        }

        /// As the Adapter and the Port take them.
        fn to_rust(&self) -> (AdapterConfig, PortConfig) {
            let mut found = None;
            let code = call("to_rust", |call| {
                let (adapter, port) = (self.adapter.as_ptr(), self.port.as_ptr());
                pointers!(call, encoded(adapter), encoded(port));
                found =
                    Some((adapter.adapter_config(), configured_port(&port, adapter.slave_count)));
                Ok(())
            });
            assert_eq!(code, 0);
            found.unwrap()
        }
    }

    /// Configurations that a Rust application passes to the Adapter and the Port.
    fn in_rust(text: &str) -> (AdapterConfig, PortConfig) {
        let file =
            ecan_lite::config::parse(text.as_bytes()).unwrap_or_else(|faults| panic!("{faults}"));
        (file.adapter, file.port)
    }

    #[test]
    fn file_has_the_same_content_in_c_and_rust() {
        let mut c = Configurations::new();
        // One after the other into the same configurations: nothing of the one before is left.
        for text in [OTHER_VALUES, EXAMPLE, OTHER_VALUES] {
            assert_eq!(c.parse(text), 0);
            assert_eq!(c.to_rust(), in_rust(text));
        }
        // The values are not the defaults.
        let (_, port) = c.to_rust();
        assert!(port.gateways.iter().all(|gateway| gateway.device.data_path.is_some()));
        assert!(port.extended_filters(0, 3)[0].sync);
    }

    #[test]
    fn file_does_not_change_library_and_simulation() {
        let mut c = Configurations::new();
        let adapter = c.adapter.as_mut_ptr();
        // SAFETY: the configuration is initialised, the text ends with NUL.
        unsafe {
            assert_eq!(ecan_igh_config_set_ecrt(adapter, c"sim:echo".as_ptr()), 0);
            assert_eq!(ecan_igh_config_set_seed(adapter, 7), 0);
        }
        assert_eq!(c.parse(EXAMPLE), 0);
        let code = call("look", |call| {
            let config = c.adapter.as_ptr();
            pointers!(call, encoded(config));
            assert_eq!(
                (config.ecrt.as_ref().and_then(|text| text.get()), config.seed),
                (Some("sim:echo"), Some(7))
            );
            Ok(())
        });
        assert_eq!(code, 0);
    }

    #[test]
    fn long_text_is_cut_between_characters() {
        let reason = "ä".repeat(IGH_MCAN_FILE_FAULT_BYTES);
        let fault = igh_mcan_file_fault_t::from(&FileFault { line: 1, column: 2, reason });
        let bytes: Vec<u8> = fault.reason.iter().map(|byte| *byte as u8).collect();
        let text = std::ffi::CStr::from_bytes_until_nul(&bytes).unwrap().to_str().unwrap();
        assert_eq!(text, "ä".repeat((IGH_MCAN_FILE_FAULT_BYTES - 1) / 2));
    }
}
