//! Lines on standard error.

use std::io::{self, Write as _};

use ecan_protocol::text::PrintableLines;

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
