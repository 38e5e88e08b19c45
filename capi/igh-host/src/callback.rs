//! Functions that an application gives to the waiting calls.

use std::ffi::{CStr, c_char, c_int, c_void};

/// Asks the application whether to stop waiting.
pub(crate) struct StopCallback {
    pub(crate) function: unsafe extern "C" fn(user: *mut c_void) -> c_int,
    pub(crate) user: *mut c_void,
}

// SAFETY: the pointer is never followed here, and passed to C only in the thread that calls a
// waiting function: the header leaves it to the application to allow that.
unsafe impl Send for StopCallback {}

impl StopCallback {
    pub(crate) fn is_stop(&self) -> bool {
        // SAFETY: the application gave the function for this, with this pointer.
        unsafe { (self.function)(self.user) != 0 }
    }
}

/// Reports the progress of an axis to the application.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ProgressCallback {
    pub(crate) function: unsafe extern "C" fn(user: *mut c_void, axis: usize, text: *const c_char),
    pub(crate) user: *mut c_void,
}

// SAFETY: as for `StopCallback`.
unsafe impl Send for ProgressCallback {}

impl ProgressCallback {
    pub(crate) fn report(&self, axis: usize, text: &CStr) {
        // SAFETY: the application gave the function for this, with this pointer; the text lives
        // until it returns.
        unsafe { (self.function)(self.user, axis, text.as_ptr()) };
    }
}
