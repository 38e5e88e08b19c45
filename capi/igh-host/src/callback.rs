//! Functions that an application gives to the waiting calls.

use std::ffi::{CString, c_char, c_int, c_void};
use std::fmt::Display;
use std::io;
use std::io::Write as _;
use std::time::Duration;

use ecan_protocol::text::PrintableLines;
use serde::{Deserialize, Serialize};

type StopFunction = unsafe extern "C-unwind" fn(user: *mut c_void) -> c_int;

/// Asks the application whether to stop waiting.
pub(crate) struct StopCallback {
    pub(crate) function: StopFunction,
    pub(crate) user: *mut c_void,
}

// SAFETY: the pointer is never followed here, and passed to C only in the thread that calls a
// waiting function: the header leaves it to the application to allow that.
unsafe impl Send for StopCallback {}

impl StopCallback {
    /// The function as the layers below call it.
    pub(crate) fn check(self) -> Box<dyn Fn() -> bool + Send> {
        Box::new(move || self.is_stop())
    }

    fn is_stop(&self) -> bool {
        let guard = UnwindGuard { callback: "ecan_igh_stop_waiting_when()" };
        // SAFETY: the application gave the function for this, with this pointer.
        let is_stop = unsafe { (self.function)(self.user) != 0 };
        std::mem::forget(guard);
        is_stop
    }
}

/// A [`StopCallback`] in a configuration, which is bytes: its addresses.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct StopAddress {
    function: u64,
    user: u64,
}

impl StopAddress {
    pub(crate) fn new(function: StopFunction, user: *mut c_void) -> Self {
        let function = (function as *const ()).expose_provenance();
        Self { function: function as u64, user: user.expose_provenance() as u64 }
    }

    #[cfg(test)]
    pub(crate) fn largest() -> Self {
        Self { function: u64::MAX, user: u64::MAX }
    }

    /// # Safety
    /// `new` made the addresses.
    pub(crate) unsafe fn callback(self) -> StopCallback {
        let function: *const () = std::ptr::with_exposed_provenance(self.function as usize);
        StopCallback {
            // SAFETY: the caller's promise: it was a function of this type.
            function: unsafe { std::mem::transmute::<*const (), StopFunction>(function) },
            user: std::ptr::with_exposed_provenance_mut(self.user as usize),
        }
    }
}

/// Reports the progress of an axis or a node to the application.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ProgressCallback {
    pub(crate) function:
        unsafe extern "C-unwind" fn(user: *mut c_void, index: usize, text: *const c_char),
    pub(crate) user: *mut c_void,
    /// The function that set it.
    pub(crate) setter: &'static str,
}

// SAFETY: as for `StopCallback`.
unsafe impl Send for ProgressCallback {}

impl ProgressCallback {
    /// Reports a text about an axis or a node.
    pub(crate) fn report(&self, index: usize, progress: &dyn Display) {
        let text = CString::new(progress.to_string()).unwrap_or_default();
        let guard = UnwindGuard { callback: self.setter };
        // SAFETY: the application gave the function for this, with this pointer; the text lives
        // until it returns.
        unsafe { (self.function)(self.user, index, text.as_ptr()) };
        std::mem::forget(guard);
    }
}

/// Ends the process if an exception leaves a callback, which Rust cannot catch.
struct UnwindGuard {
    callback: &'static str,
}

impl Drop for UnwindGuard {
    fn drop(&mut self) {
        write_line(&format!(
            "ecan: an exception left the callback of {}; the process ends: catch it in the callback",
            self.callback
        ));
        std::process::abort();
    }
}

/// Writes a line. A closed or full standard error has no effect: no error, no panic, no SIGPIPE.
pub(crate) fn write_line(line: &str) {
    let blocked = BlockedSigpipe::new();
    let written = io::stderr().write_all(format!("{}\n", PrintableLines(line)).as_bytes());
    if written.is_err_and(|error| error.kind() == io::ErrorKind::BrokenPipe) {
        blocked.take();
    }
}

/// SIGPIPE, blocked in this thread as long as this lives.
struct BlockedSigpipe {
    signal: libc::sigset_t,
    before: libc::sigset_t,
    was_pending: bool,
}

impl BlockedSigpipe {
    fn new() -> Self {
        // SAFETY: the functions write to the sets that they get; zero is a valid sigset_t.
        unsafe {
            let mut this: Self = std::mem::zeroed();
            libc::sigemptyset(&raw mut this.signal);
            libc::sigaddset(&raw mut this.signal, libc::SIGPIPE);
            let mut pending = std::mem::zeroed();
            libc::sigpending(&raw mut pending);
            this.was_pending = libc::sigismember(&raw const pending, libc::SIGPIPE) == 1;
            libc::pthread_sigmask(libc::SIG_BLOCK, &raw const this.signal, &raw mut this.before);
            this
        }
    }

    /// Takes the signal of a failed write; one of the application stays pending.
    fn take(&self) {
        if !self.was_pending {
            let none = libc::timespec { tv_sec: 0, tv_nsec: 0 };
            // SAFETY: the set and the time are valid; no information is requested.
            unsafe {
                libc::sigtimedwait(&raw const self.signal, std::ptr::null_mut(), &raw const none)
            };
        }
    }
}

impl Drop for BlockedSigpipe {
    fn drop(&mut self) {
        // SAFETY: `before` is the mask that `new` replaced.
        unsafe {
            libc::pthread_sigmask(libc::SIG_SETMASK, &raw const self.before, std::ptr::null_mut());
        }
    }
}

pub(crate) fn duration(milliseconds: u32) -> Duration {
    Duration::from_millis(milliseconds.into())
}

/// Milliseconds of a duration, at most `u32::MAX`.
pub(crate) fn milliseconds(duration: Duration) -> u32 {
    u32::try_from(duration.as_millis()).unwrap_or(u32::MAX)
}
