//! Plain Rust values in opaque structs of C.

use std::mem::MaybeUninit;

use super::call::Call;
use super::out_pointer::OutPointer;
use crate::result::ecan_result_t;

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
