//! Functions that an application gives to the waiting calls.

use std::ffi::{CStr, c_char, c_int, c_void};

use crate::standard_error;

/// Asks the application whether to stop waiting.
pub(crate) struct StopCallback {
    pub(crate) function: unsafe extern "C-unwind" fn(user: *mut c_void) -> c_int,
    pub(crate) user: *mut c_void,
}

// SAFETY: the pointer is never followed here, and passed to C only in the thread that calls a
// waiting function: the header leaves it to the application to allow that.
unsafe impl Send for StopCallback {}

impl StopCallback {
    pub(crate) fn is_stop(&self) -> bool {
        let guard = UnwindGuard { callback: "ecan_igh_stop_waiting_when()" };
        // SAFETY: the application gave the function for this, with this pointer.
        let is_stop = unsafe { (self.function)(self.user) != 0 };
        std::mem::forget(guard);
        is_stop
    }
}

/// Reports the progress of an axis to the application.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ProgressCallback {
    pub(crate) function:
        unsafe extern "C-unwind" fn(user: *mut c_void, axis: usize, text: *const c_char),
    pub(crate) user: *mut c_void,
}

// SAFETY: as for `StopCallback`.
unsafe impl Send for ProgressCallback {}

impl ProgressCallback {
    pub(crate) fn report(&self, axis: usize, text: &CStr) {
        let guard = UnwindGuard { callback: "igh_cia402_set_progress_callback()" };
        // SAFETY: the application gave the function for this, with this pointer; the text lives
        // until it returns.
        unsafe { (self.function)(self.user, axis, text.as_ptr()) };
        std::mem::forget(guard);
    }
}

/// Ends the process if an exception leaves a callback, which Rust cannot catch.
struct UnwindGuard {
    callback: &'static str,
}

impl Drop for UnwindGuard {
    fn drop(&mut self) {
        standard_error::write_line(&format!(
            "ecan: an exception left the callback of {}; the process ends: catch it in the callback",
            self.callback
        ));
        std::process::abort();
    }
}
