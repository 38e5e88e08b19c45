//! Errors of a thread, which libecan_mcan_host stores for all libraries.

use std::ffi::c_int;
use std::fmt::{self, Write};

use ecan_protocol::text::PrintableLines;

use crate::result::ecan_result_t;

// SAFETY: exported with these signatures by libecan_mcan_host for libecan_igh_host of the same
// version, and in no header. Both are safe to call from any thread.
unsafe extern "C" {
    /// Replaces the last error of this thread by one without a text.
    safe fn ecan_private_start_error(code: c_int, abort_code: u32);

    /// Appends `length` bytes of UTF-8 to the text; returns 0 if they were cut.
    fn ecan_private_extend_error(text: *const u8, length: usize) -> c_int;
}

/// Text of the last error of this thread.
struct Text;

impl Write for Text {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        // SAFETY: the bytes of a text are valid for reading.
        match unsafe { ecan_private_extend_error(text.as_ptr(), text.len()) } {
            0 => Err(fmt::Error),
            _ => Ok(()),
        }
    }
}

/// Notes an error of this thread. Allocates nothing if `text` does not.
pub fn note(function: &'static str, code: ecan_result_t, text: fmt::Arguments<'_>) {
    note_with_abort_code(function, code, text, 0);
}

/// As [`note`], with the abort code of an SDO transfer.
pub fn note_with_abort_code(
    function: &'static str,
    code: ecan_result_t,
    text: fmt::Arguments<'_>,
    abort_code: u32,
) {
    ecan_private_start_error(code.code(), abort_code);
    // A text that was cut is an error here.
    // Programs print the text, which may contain names of devices and files.
    let _ = write!(Text, "{function}: {}", PrintableLines(text));
}
