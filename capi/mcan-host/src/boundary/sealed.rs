//! Plain Rust values in opaque structs of C.

use std::mem::MaybeUninit;

use super::call::Call;
use crate::common::result::ecan_result_t;

/// A value without resources that lives in an opaque struct of C, which may copy it.
pub trait Plain: Sized {
    /// The struct of C.
    type Storage;
    /// Marks an initialised value; uninitialised memory hardly contains it by chance.
    const SEAL: u64;
    /// The function that initialises it.
    const INIT: &'static str;
}

/// Layout of the value in the struct.
#[derive(Debug)]
#[repr(C)]
pub struct Sealed<T> {
    seal: u64,
    value: MaybeUninit<T>,
}

impl<T: Plain> Sealed<T> {
    /// Evaluated at compile time.
    const FITS: () = assert!(
        !std::mem::needs_drop::<T>()
            && size_of::<Self>() <= size_of::<T::Storage>()
            && align_of::<Self>() <= align_of::<T::Storage>()
    );

    /// Stores a value; the previous content is ignored.
    ///
    /// # Errors
    /// NULL.
    ///
    /// # Safety
    /// `storage` is NULL or valid for writing.
    pub unsafe fn init(
        call: Call,
        name: &str,
        storage: *mut T::Storage,
        value: T,
    ) -> Result<(), ecan_result_t> {
        const { Self::FITS };
        // SAFETY: the caller's promise; it fits.
        let out = unsafe { call.out(name, storage.cast::<Self>())? };
        out.set(Self { seal: T::SEAL, value: MaybeUninit::new(value) });
        Ok(())
    }

    /// Borrows the value that [`init`](Self::init) stored, to change it.
    ///
    /// # Errors
    /// NULL, or not initialised.
    ///
    /// # Safety `storage` is NULL or valid for reading and writing, and not used otherwise during
    /// the call. A value follows the seal.
    pub unsafe fn change<'a>(
        call: Call,
        name: &str,
        storage: *mut T::Storage,
    ) -> Result<&'a mut T, ecan_result_t> {
        // SAFETY: the caller's promise; any bytes are good for an integer and a `MaybeUninit`.
        let sealed = unsafe {
            Self::read(call, name, storage)?;
            call.change(name, storage.cast::<Self>())?
        };
        // SAFETY: a value follows the seal.
        Ok(unsafe { sealed.value.assume_init_mut() })
    }

    /// Borrows the value that [`init`](Self::init) stored.
    ///
    /// # Errors
    /// As for [`change`](Self::change).
    ///
    /// # Safety
    /// `storage` is NULL or valid for reading, and not written to during the call. A value follows
    /// the seal.
    pub unsafe fn read<'a>(
        call: Call,
        name: &str,
        storage: *const T::Storage,
    ) -> Result<&'a T, ecan_result_t> {
        const { Self::FITS };
        // SAFETY: the caller's promise; any bytes are good for an integer and a `MaybeUninit`.
        let sealed = unsafe { call.read(name, storage.cast::<Self>())? };
        if sealed.seal != T::SEAL {
            let text = format_args!("`{name}` is not initialised: call {} first", T::INIT);
            return Err(call.fail(ecan_result_t::ECAN_ERR_NOT_INITIALISED, text));
        }
        // SAFETY: a value follows the seal.
        Ok(unsafe { sealed.value.assume_init_ref() })
    }
}
