//! A call from C: its panics, errors, pointers, texts and opaque structs.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::fmt::{self, Write};
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::slice;

use ecan_protocol::text::PrintableLines;

use crate::result::{OutArray, OutPointer, ecan_result_t};

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
        Err(panic) => failed(report_panic(call, panic.as_ref())),
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

// SAFETY: exported with these signatures by libecan_mcan_host for libecan_igh_host of the same
// version, and in no header. Both are safe to call from any thread.
unsafe extern "C" {
    /// Replaces the last error of this thread by one without a text.
    safe fn ecan_private_start_error(code: c_int, abort_code: u32);

    /// Appends `length` bytes of UTF-8 to the text; returns 0 if they were cut.
    fn ecan_private_extend_error(text: *const u8, length: usize) -> c_int;
}

/// Text of the last error of this thread.
struct LastErrorText;

impl Write for LastErrorText {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        // SAFETY: the bytes of a text are valid for reading.
        match unsafe { ecan_private_extend_error(text.as_ptr(), text.len()) } {
            0 => Err(fmt::Error),
            _ => Ok(()),
        }
    }
}

#[cold]
fn report_panic(call: Call, panic: &(dyn std::any::Any + Send)) -> ecan_result_t {
    let text = panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("unknown");
    call.fail(ecan_result_t::ECAN_ERR_INTERNAL, format_args!("internal fault: {text}"))
}

impl Call {
    /// Stores an error of this thread and returns its code. Allocates nothing if `text` does not.
    #[cold]
    pub fn fail(self, code: ecan_result_t, text: fmt::Arguments<'_>) -> ecan_result_t {
        self.fail_transfer(code, text, 0)
    }

    /// As [`fail`](Self::fail), with the abort code of an SDO transfer.
    #[cold]
    pub fn fail_transfer(
        self,
        code: ecan_result_t,
        text: fmt::Arguments<'_>,
        abort_code: u32,
    ) -> ecan_result_t {
        ecan_private_start_error(code.code(), abort_code);
        // A text that was cut is an error here.
        // Programs print the text, which may contain names of devices and files.
        let _ = write!(LastErrorText, "{}: {}", self.function, PrintableLines(text));
        code
    }

    /// Stores an error of the layers below and returns its code.
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

/// A buffer of C for a text.
///
/// One convention for all functions `(..., char *text, size_t size, size_t *needed)`: the text ends
/// with NUL and is cut between characters if it does not fit, which is `ECAN_ERR_BUFFER`. `needed` gets
/// the bytes of the whole text, NUL included. Without a buffer only `needed` is set. After another error
/// the text is empty.
#[derive(Debug)]
pub struct OutText {
    room: Option<OutArray<c_char>>,
    needed: Option<OutPointer<usize>>,
}

impl OutText {
    /// `None` for no buffer, or no interest in the size.
    fn new(room: Option<OutArray<c_char>>, needed: Option<OutPointer<usize>>) -> Self {
        if let Some(needed) = &needed {
            needed.set(0);
        }
        let mut this = Self { room, needed };
        if let Some(room) = &mut this.room {
            room.start_with(0);
        }
        this
    }

    /// Stores the text.
    ///
    /// # Errors
    /// `ECAN_ERR_BUFFER` for a text that was cut.
    pub fn put(self, call: Call, text: &str) -> Result<(), ecan_result_t> {
        let bytes = text.len() + 1;
        if let Some(needed) = &self.needed {
            needed.set(bytes);
        }
        let Some(mut room) = self.room else { return Ok(()) };
        let size = room.capacity();
        put_text(&mut room, text);
        if bytes <= size {
            return Ok(());
        }
        let text = format_args!("the text needs {bytes} bytes, the buffer has {size}");
        Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text))
    }
}

impl Call {
    /// Takes a buffer for a text, and a pointer for the bytes that the whole text needs, which may be
    /// NULL and gets 0 until the text is stored.
    ///
    /// # Safety
    /// `text` is NULL or valid for writing `size` bytes, `needed` NULL or valid for writing, as long as
    /// the result lives.
    pub unsafe fn out_text(
        self,
        name: &str,
        text: *mut c_char,
        size: usize,
        needed: *mut usize,
    ) -> Result<OutText, ecan_result_t> {
        // SAFETY: the caller's promise.
        let (needed, room) =
            unsafe { (self.optional_out("needed", needed)?, self.room(name, text, size)?) };
        Ok(OutText::new((!text.is_null()).then_some(room), needed))
    }
}

/// Copies a text into a buffer of C, with NUL at its end; cuts it if it does not fit.
pub fn put_text(room: &mut OutArray<c_char>, text: &str) {
    let mut length = text.len().min(room.capacity().saturating_sub(1));
    while !text.is_char_boundary(length) {
        length -= 1;
    }
    for byte in text.as_bytes()[..length].iter().chain(&[0]) {
        room.push(*byte as c_char);
    }
}

/// An opaque struct of C that holds a value without resources and may be copied.
pub trait Opaque: Sized + 'static {
    /// Type of the value.
    type Value: 'static;
    /// Marks an initialised value; uninitialised memory hardly contains it by chance.
    const SEAL: u64;
    /// The function that initialises it.
    const INIT: &'static str;
}

/// Layout of the value in the struct.
#[derive(Debug)]
#[repr(C)]
struct Sealed<S: Opaque> {
    seal: u64,
    value: MaybeUninit<S::Value>,
}

impl<S: Opaque> Sealed<S> {
    /// Evaluated at compile time.
    const FITS: () = assert!(
        !std::mem::needs_drop::<S::Value>()
            && size_of::<Self>() <= size_of::<S>()
            && align_of::<Self>() <= align_of::<S>()
    );
}

impl<S: Opaque> OutPointer<S> {
    /// Stores a value in an opaque struct; the previous content is ignored.
    pub fn seal(&self, value: S::Value) {
        const { Sealed::<S>::FITS };
        self.cast().set(Sealed::<S> { seal: S::SEAL, value: MaybeUninit::new(value) });
    }
}

impl Call {
    /// Borrows the value that [`OutPointer::seal`] stored, to change it.
    ///
    /// # Safety
    /// `storage` is NULL or valid for reading and writing, and not used otherwise during the call.
    /// A value follows the seal.
    pub unsafe fn sealed_mut<'a, S: Opaque>(
        self,
        name: &str,
        storage: *mut S,
    ) -> Result<&'a mut S::Value, ecan_result_t> {
        // SAFETY: the caller's promise; any bytes are good for an integer and a `MaybeUninit`.
        let sealed = unsafe {
            self.sealed(name, storage)?;
            self.change(name, storage.cast::<Sealed<S>>())?
        };
        // SAFETY: a value follows the seal.
        Ok(unsafe { sealed.value.assume_init_mut() })
    }

    /// Borrows the value that [`OutPointer::seal`] stored.
    ///
    /// # Safety
    /// `storage` is NULL or valid for reading, and not written to during the call. A value follows
    /// the seal.
    pub unsafe fn sealed<'a, S: Opaque>(
        self,
        name: &str,
        storage: *const S,
    ) -> Result<&'a S::Value, ecan_result_t> {
        const { Sealed::<S>::FITS };
        // SAFETY: the caller's promise; any bytes are good for an integer and a `MaybeUninit`.
        let sealed = unsafe { self.read(name, storage.cast::<Sealed<S>>())? };
        if sealed.seal != S::SEAL {
            let text = format_args!("`{name}` is not initialised: call {} first", S::INIT);
            return Err(self.fail(ecan_result_t::ECAN_ERR_NOT_INITIALISED, text));
        }
        // SAFETY: a value follows the seal.
        Ok(unsafe { sealed.value.assume_init_ref() })
    }
}

/// The last error of a thread of the tests, in place of that of libecan_mcan_host.
#[cfg(test)]
mod last_error_of_tests {
    use std::cell::RefCell;
    use std::ffi::c_int;

    thread_local! {
        static TEXT: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
    }

    pub fn text() -> String {
        String::from_utf8(TEXT.take()).unwrap()
    }

    #[unsafe(no_mangle)]
    extern "C" fn ecan_private_start_error(_: c_int, _: u32) {
        TEXT.take();
    }

    // SAFETY: `text` points at `length` bytes.
    #[unsafe(no_mangle)]
    unsafe extern "C" fn ecan_private_extend_error(text: *const u8, length: usize) -> c_int {
        // SAFETY: as the caller promises.
        let text = unsafe { std::slice::from_raw_parts(text, length) };
        TEXT.with_borrow_mut(|stored| stored.extend_from_slice(text));
        1
    }
}

#[cfg(test)]
mod tests {
    use std::ptr::null_mut;

    use super::*;

    #[test]
    fn panic_becomes_a_code() {
        let code = call("f", |_| panic!("at {}", "work"));
        assert_eq!(code, ecan_result_t::ECAN_ERR_INTERNAL.code());
        assert_eq!(last_error_of_tests::text(), "f: internal fault: at work");
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

    fn put(text: &mut [c_char], needed: *mut usize) -> i32 {
        call("f", |call| {
            // SAFETY: the pointers are valid.
            let out = unsafe { call.out_text("text", text.as_mut_ptr(), text.len(), needed)? };
            out.put(call, "aöö")
        })
    }

    #[test]
    fn long_text_is_cut_between_characters() {
        let mut needed = 99;
        let mut buffer = [1; 5];
        assert_eq!(put(&mut buffer, &raw mut needed), ecan_result_t::ECAN_ERR_BUFFER.code());
        assert_eq!(buffer.map(|c| c as u8), [b'a', 0xC3, 0xB6, 0, 1]);
        assert_eq!(needed, 6);
        let mut whole = [1; 6];
        assert_eq!(put(&mut whole, null_mut()), 0);
        assert_eq!(whole[5], 0);
        assert_eq!(put(&mut [], null_mut()), ecan_result_t::ECAN_ERR_BUFFER.code());
    }

    #[test]
    fn text_without_buffer_only_has_a_size() {
        let mut needed = 99;
        let code = call("f", |call| {
            // SAFETY: NULL is allowed without a size.
            let out = unsafe { call.out_text("text", null_mut(), 0, &raw mut needed)? };
            assert_eq!(needed, 0);
            out.put(call, "abc")
        });
        assert_eq!((code, needed), (0, 4));
    }
}
