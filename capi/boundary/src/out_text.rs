//! Buffers of C for texts.

use std::ffi::c_char;

use super::call::Call;
use super::out_pointer::{OutArray, OutPointer};
use crate::result::ecan_result_t;

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

#[cfg(test)]
mod tests {
    use std::ptr::null_mut;

    use super::*;
    use crate::call::call;

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
