//! Shared part of all C headers: `igh_ecan_common.h`.

use std::cell::RefCell;
use std::ffi::{c_char, c_int};
use std::slice;

use ecan_c_boundary::result::{Meaning, ecan_result_t};

/// Size of the text buffer; a longer text is cut.
const TEXT_BYTES: usize = 8192;

struct LastError {
    code: c_int,
    abort_code: u32,
    length: usize,
    text: [u8; TEXT_BYTES],
}

impl LastError {
    const fn none() -> Self {
        Self { code: 0, abort_code: 0, length: 0, text: [0; TEXT_BYTES] }
    }

    fn start(&mut self, code: c_int, abort_code: u32) {
        (self.code, self.abort_code, self.length) = (code, abort_code, 0);
        self.text[0] = 0;
    }

    /// Appends up to the end of the buffer, with NUL after it; a text is cut between characters
    /// only. Returns false for a text that was cut.
    fn extend(&mut self, text: &[u8]) -> bool {
        let is_continuation = |byte: &u8| byte & 0xC0 == 0x80;
        let mut length = (TEXT_BYTES - 1 - self.length).min(text.len());
        while length > 0 && text.get(length).is_some_and(is_continuation) {
            length -= 1;
        }
        self.text[self.length..self.length + length].copy_from_slice(&text[..length]);
        self.length += length;
        self.text[self.length] = 0;
        length == text.len()
    }
}

thread_local! {
    // Constant and without a destructor, so that access never allocates.
    static LAST: RefCell<LastError> = const { RefCell::new(LastError::none()) };
}

// The next two functions are for libecan_igh_host of the same version. They are in no header, and their
// version node `ECAN_PRIVATE_x.y.z` in the version script names the exact version.

/// Replaces the last error of this thread by one without a text.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_private_start_error(code: c_int, abort_code: u32) {
    let _ = LAST.try_with(|last| last.borrow_mut().start(code, abort_code));
}

/// Appends UTF-8 to the text of the last error of this thread; returns 0 if it was cut, else 1.
///
/// # Safety
/// `text` is valid for reading `length` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_private_extend_error(text: *const u8, length: usize) -> c_int {
    // SAFETY: the caller's promise.
    let text = unsafe { slice::from_raw_parts(text, length) };
    LAST.try_with(|last| last.borrow_mut().extend(text)).unwrap_or(true).into()
}

// Section: The last error

/// Returns the text of this thread's last error: the function, the slave, the object and the
/// reason.
///
/// A successful call does not change it, like errno.
///
/// @usage   rt, any thread, any time
/// @return  The text, in UTF-8; "" before the first error. Valid until the thread's next error, and
///          not in another thread.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_last_error() -> *const c_char {
    LAST.try_with(|last| last.borrow().text.as_ptr().cast()).unwrap_or(c"".as_ptr())
}

/// Returns the code of ecan_last_error().
///
/// @usage   rt, any thread, any time
/// @return  A negative ecan_result_t; 0 before the first error.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_last_error_code() -> c_int {
    LAST.try_with(|last| last.borrow().code).unwrap_or(0)
}

/// Returns the abort code with which a slave or a CANopen node aborted the SDO transfer of the last
/// error.
///
/// @usage   rt, any thread, any time
/// @return  0x06090030 for example; 0 if the last error was not an aborted transfer.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_last_abort_code() -> u32 {
    LAST.try_with(|last| last.borrow().abort_code).unwrap_or(0)
}

/// Clears the last error of this thread.
///
/// @usage   rt, any thread, any time
#[unsafe(no_mangle)]
pub extern "C" fn ecan_clear_last_error() {
    ecan_private_start_error(0, 0);
}

// Section: Return values

/// Returns the name of a code, as it is written in this header.
///
/// @usage   rt, any thread, any time
/// @return  "ECAN_ERR_SDO" for example; "unknown result" for a value that is not a code. Static.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_result_name(code: c_int) -> *const c_char {
    let pair = ecan_result_t::PAIRS.iter().find(|(result, ..)| result.code() == code);
    pair.map_or(c"unknown result".as_ptr(), |(_, name, _)| name.as_ptr().cast())
}

/// Returns a short description of a code.
///
/// @usage   rt, any thread, any time
/// @return  "an SDO transfer failed" for example. Static.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_result_text(code: c_int) -> *const c_char {
    let meaning = ecan_result_t::to_rust(code);
    let text = meaning.map(|(Meaning::Lasting(text) | Meaning::Temporary(text))| text);
    text.unwrap_or(c"unknown result").as_ptr()
}

/// Returns 1 for a code after which a frame may be sent again in a later cycle: the image or the
/// queue is full, the channel is bus-off, or the gateway is not ready.
///
/// @usage   rt, any thread, any time
/// @return  1 or 0.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_result_is_temporary(code: c_int) -> c_int {
    matches!(ecan_result_t::to_rust(code), Some(Meaning::Temporary(_))).into()
}

// Section: Version of the library

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

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use ecan_c_boundary::call;
    use ecan_c_boundary::result::ecan_result_t;

    use super::*;

    fn text() -> String {
        // SAFETY: the text ends with NUL and is not changed before it was copied.
        unsafe { CStr::from_ptr(ecan_last_error()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn error_is_visible_in_its_thread_only() {
        call("f", |call| {
            Err(call.fail_transfer(ecan_result_t::ECAN_ERR_SDO, format_args!("slave {}", 2), 7))
        });
        assert_eq!(text(), "f: slave 2");
        assert_eq!((ecan_last_error_code(), ecan_last_abort_code()), (-24, 7));
        let other = std::thread::spawn(|| (text(), ecan_last_error_code())).join().unwrap();
        assert_eq!(other, (String::new(), 0));
        call("g", |call| {
            Err(call.fail(ecan_result_t::ECAN_ERR_NULL, format_args!("`port` is NULL")))
        });
        assert_eq!((text(), ecan_last_abort_code()), ("g: `port` is NULL".into(), 0));
        ecan_clear_last_error();
        assert_eq!((text(), ecan_last_error_code()), (String::new(), 0));
    }

    #[test]
    fn long_text_is_cut_between_characters() {
        call("f", |call| {
            let text = "ä".repeat(TEXT_BYTES);
            Err(call.fail(ecan_result_t::ECAN_ERR_CONFIG, format_args!("{text}")))
        });
        let cut = text();
        assert!(cut.len() >= TEXT_BYTES - 2 && cut.len() < TEXT_BYTES, "{}", cut.len());
        assert!(cut.ends_with('ä'));
    }

    #[test]
    fn every_code_has_its_name_and_text() {
        for (result, ..) in ecan_result_t::PAIRS {
            // SAFETY: both functions return static C strings.
            let name = unsafe { CStr::from_ptr(ecan_result_name(result.code())) };
            // SAFETY: as above.
            let text = unsafe { CStr::from_ptr(ecan_result_text(result.code())) };
            assert_eq!(name.to_str().unwrap(), format!("{result:?}"));
            assert!(!text.is_empty());
            assert!(result.code() <= 0);
        }
        let unknown = c"unknown result";
        // SAFETY: as above.
        assert_eq!(unsafe { CStr::from_ptr(ecan_result_name(7)) }, unknown);
    }
}
