//! Version of the library

use std::ffi::{c_char, c_int};

const fn number(text: &str) -> c_int {
    let bytes = text.as_bytes();
    let mut value = 0;
    let mut at = 0;
    while at < bytes.len() {
        value = value * 10 + (bytes[at] - b'0') as c_int;
        at += 1;
    }
    value
}

/// Returns the version of the linked library: major * 10000 + minor * 100 + patch.
///
/// Compare it with ECAN_VERSION, the version of the header.
///
/// @usage   rt, any thread, any time
/// @return  200 for 0.2.0.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_version() -> c_int {
    number(env!("CARGO_PKG_VERSION_MAJOR")) * 10_000
        + number(env!("CARGO_PKG_VERSION_MINOR")) * 100
        + number(env!("CARGO_PKG_VERSION_PATCH"))
}

/// Returns the version of the linked library as text.
///
/// @usage   rt, any thread, any time
/// @return  "0.2.0" for example. Static.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_version_text() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}
