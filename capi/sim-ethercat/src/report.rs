//! Words on stderr, as the real library writes them when a call fails.

use std::fmt;
use std::io::{self, Write};

use ecrt_sys::Errno;
use libc::c_int;

/// What a function of the library returns.
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

/// Passes on what a function returned; a failure is told.
pub(crate) fn told<R: Outcome>(function: &str, result: R) -> R {
    if let Some(errno) = result.failure() {
        line(format_args!("{function}: {errno}"));
        errno.set_last();
    }
    result
}

/// Writes a line to stderr. Whoever has closed it wants to read none.
pub(crate) fn line(text: fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "libethercat (simulated): {text}");
}
