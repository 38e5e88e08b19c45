//! What tests need that call the functions as a C program does.

use std::ffi::{CStr, c_int};

use ecan_c_boundary::result::ecan_result_t;
use ecan_mcan_host::common::ecan_last_error;

pub fn code(result: ecan_result_t) -> c_int {
    result.code()
}

pub fn error() -> String {
    // SAFETY: the text ends with NUL and is not changed before it was copied.
    unsafe { CStr::from_ptr(ecan_last_error()) }.to_str().unwrap().to_owned()
}

#[track_caller]
pub fn ok(code: c_int) {
    assert_eq!(code, 0, "{}", error());
}

/// Bytes as a C program finds them on its stack.
pub fn garbage<T>() -> Box<T> {
    let mut buffer = Box::<T>::new_uninit();
    // SAFETY: valid for this number of bytes; used for structs of integers only.
    unsafe {
        buffer.as_mut_ptr().cast::<u8>().write_bytes(0xA5, size_of::<T>());
        buffer.assume_init()
    }
}
