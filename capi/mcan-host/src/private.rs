//! Functions for libecan_igh_host of the same version. They are in no header, and their version node
//! `ECAN_PRIVATE_x.y.z` in the version script names the exact version.

use std::ffi::c_int;
use std::slice;

use crate::common::last_error;

/// Replaces the last error of this thread by one without a text.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_private_start_error(code: c_int, abort_code: u32) {
    last_error::start(code, abort_code);
}

/// Appends UTF-8 to the text of the last error of this thread; returns 0 if it was cut, else 1.
///
/// # Safety
/// `text` is valid for reading `length` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_private_extend_error(text: *const u8, length: usize) -> c_int {
    // SAFETY: the caller's promise.
    last_error::extend(unsafe { slice::from_raw_parts(text, length) }).into()
}
