//! A call from C: its panics, pointers and errors.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::slice;

use super::out_pointer::{OutArray, OutPointer};
use crate::last_error;
use crate::result::ecan_result_t;

/// Text for a struct of the application with a reserved field that is not 0.
pub const RESERVED_IS_SET: &str = "has a reserved field that is not 0; set the struct to 0 first";

/// An error of the layers below, as C sees it.
pub trait ToResult: fmt::Display {
    /// Its code.
    fn result(&self) -> ecan_result_t;
}

/// A call from C.
#[derive(Clone, Copy, Debug)]
pub struct Call {
    function: &'static str,
}

/// Runs a call from C and returns its return value.
#[inline(always)]
pub fn call(function: &'static str, body: impl FnOnce(Call) -> Result<(), ecan_result_t>) -> c_int {
    code_getter(function, |call| body(call).map(|()| 0))
}

/// Runs a call from C that returns a value; `failed` makes the value of an error.
#[inline(always)]
pub fn getter<R>(
    function: &'static str,
    failed: impl FnOnce(ecan_result_t) -> R,
    body: impl FnOnce(Call) -> Result<R, ecan_result_t>,
) -> R {
    let call = Call { function };
    // A panic leaves unfinished work only in a poisoned handle or in the caller's own objects.
    match catch_unwind(AssertUnwindSafe(|| body(call))) {
        Ok(Ok(value)) => value,
        Ok(Err(error)) => failed(error),
        Err(panic) => failed(panicked(call, panic.as_ref())),
    }
}

/// Checks pointers of C, each by the method of [`Call`] with the name of its kind, and binds the
/// results to the names of the pointers: `pointers!(call, items(data, len), out(count))`.
#[macro_export]
macro_rules! pointers {
    ($call:ident, $($kind:ident($pointer:ident $(, $more:ident)*)),+) => {$(
        #[allow(unused_mut, reason = "only arrays for results change")]
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let mut $pointer = unsafe { $call.$kind(stringify!($pointer), $pointer $(, $more)*)? };
    )+};
}

/// As [`getter`], of a number that is never negative: an error is its code.
#[inline(always)]
pub fn code_getter(
    function: &'static str,
    body: impl FnOnce(Call) -> Result<c_int, ecan_result_t>,
) -> c_int {
    getter(function, ecan_result_t::code, body)
}

/// As [`getter`], with a fixed value for every error.
#[inline(always)]
pub fn getter_or<R>(
    function: &'static str,
    failed: R,
    body: impl FnOnce(Call) -> Result<R, ecan_result_t>,
) -> R {
    getter(function, |_| failed, body)
}

#[cold]
fn panicked(call: Call, panic: &(dyn std::any::Any + Send)) -> ecan_result_t {
    let text = panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("unknown");
    call.fail(ecan_result_t::ECAN_ERR_INTERNAL, format_args!("internal fault: {text}"))
}

impl Call {
    /// Name of the called function.
    pub fn function(self) -> &'static str {
        self.function
    }

    /// Notes an error and returns its code.
    #[cold]
    pub fn fail(self, code: ecan_result_t, text: fmt::Arguments<'_>) -> ecan_result_t {
        last_error::note(self.function, code, text);
        code
    }

    /// Notes an error of the layers below and returns its code.
    #[cold]
    pub fn error(self, error: &dyn ToResult) -> ecan_result_t {
        self.fail(error.result(), format_args!("{error}"))
    }

    /// Reports a value out of range.
    #[cold]
    pub fn argument(self, name: &str, text: fmt::Arguments<'_>) -> ecan_result_t {
        self.fail(ecan_result_t::ECAN_ERR_ARGUMENT, format_args!("`{name}` {text}"))
    }

    /// Checks the reserved fields of a struct that the application fills.
    #[inline]
    pub fn reserved<T: Default + PartialEq>(
        self,
        name: &str,
        fields: &[T],
    ) -> Result<(), ecan_result_t> {
        if fields.iter().all(|field| *field == T::default()) {
            return Ok(());
        }
        Err(self.argument(name, format_args!("{RESERVED_IS_SET}")))
    }

    #[cold]
    pub(super) fn null(self, name: &str) -> ecan_result_t {
        self.fail(ecan_result_t::ECAN_ERR_NULL, format_args!("`{name}` is NULL"))
    }

    /// Borrows a value of C.
    ///
    /// # Safety
    /// `pointer` is NULL or valid for reading, and not written to during the call.
    #[inline]
    pub unsafe fn read<'a, T>(self, name: &str, pointer: *const T) -> Result<&'a T, ecan_result_t> {
        // SAFETY: the caller's promise.
        unsafe { pointer.as_ref() }.ok_or_else(|| self.null(name))
    }

    /// Borrows a value of C; NULL is allowed for none.
    ///
    /// # Safety
    /// As for [`read`](Self::read).
    #[inline]
    pub unsafe fn optional<'a, T>(
        self,
        _name: &str,
        pointer: *const T,
    ) -> Result<Option<&'a T>, ecan_result_t> {
        // SAFETY: the caller's promise.
        Ok(unsafe { pointer.as_ref() })
    }

    /// Borrows an initialised value of C to change it.
    ///
    /// # Safety
    /// `pointer` is NULL or valid for reading and writing, and not used otherwise during the call.
    #[inline]
    pub unsafe fn change<'a, T>(
        self,
        name: &str,
        pointer: *mut T,
    ) -> Result<&'a mut T, ecan_result_t> {
        // SAFETY: the caller's promise.
        unsafe { pointer.as_mut() }.ok_or_else(|| self.null(name))
    }

    /// Takes a pointer for a result; its content is ignored.
    ///
    /// # Safety
    /// `pointer` is NULL or valid for writing as long as the result lives.
    #[inline]
    pub unsafe fn out<T>(
        self,
        name: &str,
        pointer: *mut T,
    ) -> Result<OutPointer<T>, ecan_result_t> {
        OutPointer::new(pointer).ok_or_else(|| self.null(name))
    }

    /// Takes a pointer for a result that may be NULL.
    ///
    /// # Safety
    /// As for [`out`](Self::out).
    #[inline]
    pub unsafe fn optional_out<T>(
        self,
        _name: &str,
        pointer: *mut T,
    ) -> Result<Option<OutPointer<T>>, ecan_result_t> {
        Ok(OutPointer::new(pointer))
    }

    /// Borrows items of C; NULL is allowed for none.
    ///
    /// # Safety
    /// `items` is NULL or valid for reading `count` items, and not written to during the call.
    #[inline]
    pub unsafe fn items<'a, T>(
        self,
        name: &str,
        items: *const T,
        count: usize,
    ) -> Result<&'a [T], ecan_result_t> {
        if count == 0 {
            return Ok(&[]);
        }
        if items.is_null() {
            return Err(self.null(name));
        }
        self.size::<T>(name, count)?;
        // SAFETY: not NULL and of a possible size, so valid by the caller's promise.
        Ok(unsafe { slice::from_raw_parts(items, count) })
    }

    /// Takes an array for items.
    ///
    /// # Safety
    /// `items` is NULL or valid for writing `capacity` items as long as the result lives.
    #[inline]
    pub unsafe fn room<T>(
        self,
        name: &str,
        items: *mut T,
        capacity: usize,
    ) -> Result<OutArray<T>, ecan_result_t> {
        if items.is_null() && capacity > 0 {
            return Err(self.null(name));
        }
        self.size::<T>(name, capacity)?;
        Ok(OutArray::new(items, capacity))
    }

    /// As [`items`](Self::items), of bytes.
    ///
    /// # Safety
    /// As there.
    #[inline]
    pub unsafe fn bytes<'a>(
        self,
        name: &str,
        bytes: *const c_void,
        count: usize,
    ) -> Result<&'a [u8], ecan_result_t> {
        // SAFETY: the caller's promise.
        unsafe { self.items(name, bytes.cast(), count) }
    }

    /// As [`room`](Self::room), for bytes.
    ///
    /// # Safety
    /// As there.
    #[inline]
    pub unsafe fn byte_room(
        self,
        name: &str,
        bytes: *mut c_void,
        capacity: usize,
    ) -> Result<OutArray<u8>, ecan_result_t> {
        // SAFETY: the caller's promise.
        unsafe { self.room(name, bytes.cast(), capacity) }
    }

    #[inline]
    fn size<T>(self, name: &str, count: usize) -> Result<(), ecan_result_t> {
        let bytes = count.checked_mul(size_of::<T>());
        if bytes.is_none_or(|bytes| bytes > isize::MAX as usize) {
            return Err(self.argument(
                name,
                format_args!("with {count} items is larger than the address space"),
            ));
        }
        Ok(())
    }

    /// Borrows bytes of C that end with NUL: a text of any encoding, or a path.
    ///
    /// # Safety
    /// `bytes` is NULL or ends with NUL, and is not written to during the call.
    pub unsafe fn c_str<'a>(
        self,
        name: &str,
        bytes: *const c_char,
    ) -> Result<&'a CStr, ecan_result_t> {
        if bytes.is_null() {
            return Err(self.null(name));
        }
        // SAFETY: not NULL, so it ends with NUL by the caller's promise.
        Ok(unsafe { CStr::from_ptr(bytes) })
    }

    /// Borrows a text of C.
    ///
    /// # Safety
    /// `text` is NULL or ends with NUL, and is not written to during the call.
    pub unsafe fn text<'a>(
        self,
        name: &str,
        text: *const c_char,
    ) -> Result<&'a str, ecan_result_t> {
        // SAFETY: the caller's promise.
        let text = unsafe { self.c_str(name, text)? };
        text.to_str().map_err(|_| self.argument(name, format_args!("is not UTF-8")))
    }
}

#[cfg(test)]
mod tests {
    use ecan_mcan_host::common::last_error::ecan_last_error;

    use super::*;

    #[test]
    fn panic_becomes_a_code() {
        let code = call("f", |_| panic!("at {}", "work"));
        assert_eq!(code, ecan_result_t::ECAN_ERR_INTERNAL.code());
        // SAFETY: the text ends with NUL and is not changed while it is read.
        let text = unsafe { CStr::from_ptr(ecan_last_error()) };
        assert_eq!(text.to_str(), Ok("f: internal fault: at work"));
    }

    #[test]
    fn null_is_rejected_except_for_no_items() {
        let call = Call { function: "f" };
        // SAFETY: NULL is allowed everywhere here.
        unsafe {
            assert_eq!(call.read("x", std::ptr::null::<u8>()), Err(ecan_result_t::ECAN_ERR_NULL));
            assert_eq!(call.items("x", std::ptr::null::<u8>(), 0), Ok([].as_slice()));
            assert!(call.items("x", std::ptr::null::<u8>(), 1).is_err());
            assert!(call.room("x", std::ptr::null_mut::<u8>(), 1).is_err());
            assert!(
                call.items("x", std::ptr::NonNull::<u64>::dangling().as_ptr(), usize::MAX).is_err()
            );
        }
    }
}
