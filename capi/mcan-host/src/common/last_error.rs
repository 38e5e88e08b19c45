//! The last error

use std::cell::RefCell;
use std::ffi::{c_char, c_int};

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

/// Replaces the last error of this thread by one without a text.
pub(crate) fn start(code: c_int, abort_code: u32) {
    let _ = LAST.try_with(|last| last.borrow_mut().start(code, abort_code));
}

/// Appends UTF-8 to the text of the last error of this thread; returns false for a text that was cut.
pub(crate) fn extend(text: &[u8]) -> bool {
    LAST.try_with(|last| last.borrow_mut().extend(text)).unwrap_or(true)
}

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
    start(0, 0);
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use ecan_c_boundary::last_error::{note, note_with_abort_code};
    use ecan_c_boundary::result::ecan_result_t;

    use super::*;

    fn text() -> String {
        // SAFETY: the text ends with NUL and is not changed before it was copied.
        unsafe { CStr::from_ptr(ecan_last_error()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn error_is_visible_in_its_thread_only() {
        note_with_abort_code("f", ecan_result_t::ECAN_ERR_SDO, format_args!("slave {}", 2), 7);
        assert_eq!(text(), "f: slave 2");
        assert_eq!((ecan_last_error_code(), ecan_last_abort_code()), (-24, 7));
        let other = std::thread::spawn(|| (text(), ecan_last_error_code())).join().unwrap();
        assert_eq!(other, (String::new(), 0));
        note("g", ecan_result_t::ECAN_ERR_NULL, format_args!("`port` is NULL"));
        assert_eq!((text(), ecan_last_abort_code()), ("g: `port` is NULL".into(), 0));
        ecan_clear_last_error();
        assert_eq!((text(), ecan_last_error_code()), (String::new(), 0));
    }

    #[test]
    fn long_text_is_cut_between_characters() {
        note("f", ecan_result_t::ECAN_ERR_CONFIG, format_args!("{}", "ä".repeat(TEXT_BYTES)));
        let cut = text();
        assert!(cut.len() >= TEXT_BYTES - 2 && cut.len() < TEXT_BYTES, "{}", cut.len());
        assert!(cut.ends_with('ä'));
    }
}
