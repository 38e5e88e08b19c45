//! Plain Rust values in opaque structs of C.

use std::mem::MaybeUninit;

use super::call::Call;
use crate::common::result::ecan_result_t;

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
pub struct Sealed<S: Opaque> {
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
        storage: *mut S,
        value: S::Value,
    ) -> Result<(), ecan_result_t> {
        const { Self::FITS };
        // SAFETY: the caller's promise; it fits.
        let out = unsafe { call.out(name, storage.cast::<Self>())? };
        out.set(Self { seal: S::SEAL, value: MaybeUninit::new(value) });
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
        storage: *mut S,
    ) -> Result<&'a mut S::Value, ecan_result_t> {
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
        storage: *const S,
    ) -> Result<&'a S::Value, ecan_result_t> {
        const { Self::FITS };
        // SAFETY: the caller's promise; any bytes are good for an integer and a `MaybeUninit`.
        let sealed = unsafe { call.read(name, storage.cast::<Self>())? };
        if sealed.seal != S::SEAL {
            let text = format_args!("`{name}` is not initialised: call {} first", S::INIT);
            return Err(call.fail(ecan_result_t::ECAN_ERR_NOT_INITIALISED, text));
        }
        // SAFETY: a value follows the seal.
        Ok(unsafe { sealed.value.assume_init_ref() })
    }
}
