//! Error messages on stderr, as the real library writes them.

use std::fmt;
use std::io::{self, Write};

use ecrt_sys::Errno;
use libc::c_int;

/// Return value of a library function.
pub(crate) trait Outcome {
    /// The error number, if the call failed.
    fn failure(&self) -> Option<Errno>;
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

/// Reports a failure on stderr, and returns the result.
pub(crate) fn reported<R: Outcome>(function: &str, result: R) -> R {
    if let Some(errno) = result.failure() {
        line(format_args!("{function}: {errno}"));
        errno.set_last();
    }
    result
}

/// Writes a line to stderr; a closed stderr is ignored.
pub(crate) fn line(text: fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "libethercat (simulated): {text}");
}
