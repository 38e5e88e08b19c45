//! Error messages on stderr, as the real library writes them.

use std::fmt;
use std::io::{self, Write};

use ecrt_sys::Errno;
use libc::{c_int, size_t};

/// Return value of a library function.
pub(crate) trait Outcome {
    /// The error number, if the call failed.
    fn failure(&self) -> Option<Errno> {
        None
    }
}

impl Outcome for c_int {
    fn failure(&self) -> Option<Errno> {
        (*self < 0).then(|| Errno::new(self.saturating_neg()))
    }
}

impl<T> Outcome for *mut T {
    fn failure(&self) -> Option<Errno> {
        self.is_null().then(Errno::last)
    }
}

impl Outcome for () {}
impl Outcome for u32 {}
impl Outcome for size_t {}

/// Functions whose failures the real library does not report, by the beginning of their names or by
/// their names: those of the cycle and a few more.
const SILENT_GROUPS: [&str; 4] =
    ["ecrt_sdo_request_", "ecrt_reg_request_", "ecrt_soe_request_", "ecrt_voe_handler_"];
const SILENT: [&str; 18] = [
    "ecrt_domain_data",
    "ecrt_domain_process",
    "ecrt_domain_queue",
    "ecrt_domain_state",
    "ecrt_master_application_time",
    "ecrt_master_deactivate",
    "ecrt_master_receive",
    "ecrt_master_reset",
    "ecrt_master_send",
    "ecrt_master_set_send_interval",
    "ecrt_master_state",
    "ecrt_master_sync_monitor_queue",
    "ecrt_master_sync_reference_clock",
    "ecrt_master_sync_reference_clock_to",
    "ecrt_master_sync_slave_clocks",
    "ecrt_slave_config_dc",
    // programs poll for messages in the cycle; no message is not a failure
    "ecrt_slave_config_emerg_pop",
    "ecrt_slave_config_state",
];

fn is_silent(function: &str) -> bool {
    SILENT.contains(&function) || SILENT_GROUPS.iter().any(|group| function.starts_with(group))
}

/// Reports a failure on stderr, and returns the result.
pub(crate) fn reported<R: Outcome>(function: &str, result: R) -> R {
    if let Some(errno) = result.failure().filter(|_| !is_silent(function)) {
        line(format_args!("{function}: {errno}"));
        errno.set_last();
    }
    result
}

/// Writes a line to stderr; a closed stderr is ignored.
pub(crate) fn line(text: fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "libethercat (simulated): {text}");
}
