//! A standard error that cannot be written to, as of a daemon. One test, because it is that of the
//! process.
#![allow(missing_docs)]

mod c_port;

use std::fs::File;
use std::io;
use std::os::fd::{AsRawFd as _, IntoRawFd as _};

use c_port::CPort;

#[test]
fn broken_standard_error_changes_no_result() {
    // SAFETY: the descriptors are valid, and SIGPIPE gets its default, as in a C program.
    let restore = unsafe {
        libc::signal(libc::SIGPIPE, libc::SIG_DFL);
        libc::dup(2)
    };
    let full = File::options().write(true).open("/dev/full").unwrap();
    let (reader, writer) = io::pipe().unwrap();
    drop(reader);
    for broken in [full.as_raw_fd(), writer.into_raw_fd()] {
        // SAFETY: as above.
        unsafe { libc::dup2(broken, 2) };
        assert!(!CPort::ready(1).port().is_null());
    }
    // SAFETY: as above; the last descriptor is restored.
    unsafe {
        libc::close(2);
        assert!(!CPort::ready(1).port().is_null());
        libc::dup2(restore, 2);
    }
}
