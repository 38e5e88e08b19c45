//! Calls with a context of C: enter it, work on its layer, store the result.

use std::ffi::c_int;

use ecan_mcan_host::boundary::{Call, Opaque, call, getter};
use ecan_mcan_host::common::result::ecan_result_t;

use crate::handle::{self, Entered, Kind, Pooled, Words};

/// A context struct of C.
pub(crate) trait Context: Sized {
    /// The object that it names.
    type Object: Pooled;
    const KIND: Kind;
    /// The layer that calls with this context work on.
    type Layer<'a>;

    /// Returns false for a context that outlived its part of the object.
    fn is_current(_: &Entered<Self::Object>) -> bool {
        true
    }

    fn layer(
        call: Call,
        object: &mut Entered<Self::Object>,
    ) -> Result<Self::Layer<'_>, ecan_result_t>;
}

/// A call with a context, before it is entered; made by `export`.
pub(crate) struct Entry<C> {
    function: &'static str,
    context: *const C,
}

impl<C: Context> Entry<C> {
    /// # Safety
    /// `context` is NULL or valid for reading as long as this lives, with any content.
    pub(crate) unsafe fn new(function: &'static str, context: *const C) -> Self {
        Self { function, context }
    }

    /// Works on the whole object.
    #[inline(always)]
    pub(crate) fn on_bus(
        self,
        work: impl FnOnce(Call, &mut Entered<C::Object>) -> Result<(), ecan_result_t>,
    ) -> c_int {
        self.get_on_bus(|call, bus| work(call, bus).map(|()| 0))
    }

    /// Ends the object or its part that the context names, if any.
    pub(crate) fn end(self, end: impl FnOnce(Entered<C::Object>)) -> c_int {
        call(self.function, |call| {
            // SAFETY: the promise of `new`.
            let object = unsafe { handle::enter_to_end(call, self.context.cast(), C::KIND)? };
            object.filter(C::is_current).map(end);
            Ok(())
        })
    }

    /// Works on the context's layer.
    #[inline(always)]
    pub(crate) fn run(
        self,
        work: impl FnOnce(Call, C::Layer<'_>) -> Result<(), ecan_result_t>,
    ) -> c_int {
        self.on_bus(|call, bus| work(call, C::layer(call, bus)?))
    }

    /// Returns a number; `failed` is returned in its place after an error.
    #[inline(always)]
    pub(crate) fn get_or<R>(
        self,
        failed: R,
        work: impl FnOnce(Call, C::Layer<'_>) -> Result<R, ecan_result_t>,
    ) -> R {
        self.get_with(|_| failed, |call, bus| work(call, C::layer(call, bus)?))
    }

    /// Returns a number, or the code of an error.
    #[inline(always)]
    pub(crate) fn get(
        self,
        work: impl FnOnce(Call, C::Layer<'_>) -> Result<c_int, ecan_result_t>,
    ) -> c_int {
        self.get_on_bus(|call, bus| work(call, C::layer(call, bus)?))
    }

    /// As [`get`](Self::get), of the whole object.
    #[inline(always)]
    pub(crate) fn get_on_bus(
        self,
        work: impl FnOnce(Call, &mut Entered<C::Object>) -> Result<c_int, ecan_result_t>,
    ) -> c_int {
        self.get_with(ecan_result_t::code, work)
    }

    #[inline(always)]
    fn get_with<R>(
        self,
        failed: impl FnOnce(ecan_result_t) -> R,
        work: impl FnOnce(Call, &mut Entered<C::Object>) -> Result<R, ecan_result_t>,
    ) -> R {
        getter(self.function, failed, |call| {
            const { assert!(size_of::<Words>() == size_of::<C>()) };
            // SAFETY: the promise of `new`.
            let mut object = unsafe { handle::enter(call, self.context.cast(), C::KIND)? };
            if !C::is_current(&object) {
                return Err(handle::not_initialised(call, C::KIND));
            }
            work(call, &mut object)
        })
    }
}

/// As [`Entry`], for a call that stores one result.
pub(crate) struct EntryInto<C, T> {
    entry: Entry<C>,
    name: &'static str,
    out: *mut T,
}

impl<C: Context, T> EntryInto<C, T> {
    /// # Safety
    /// As for [`Entry::new`]; `out` is NULL or valid for writing as long as this lives.
    pub(crate) unsafe fn new(entry: Entry<C>, name: &'static str, out: *mut T) -> Self {
        Self { entry, name, out }
    }

    /// Stores the result of the work on the context's layer.
    #[inline(always)]
    pub(crate) fn fill(
        self,
        work: impl FnOnce(Call, C::Layer<'_>) -> Result<T, ecan_result_t>,
    ) -> c_int {
        self.entry.on_bus(|call, bus| {
            // SAFETY: the promise of `new`.
            let out = unsafe { call.out(self.name, self.out)? };
            out.set(work(call, C::layer(call, bus)?)?);
            Ok(())
        })
    }
}

/// A call that changes a configuration of C; made by `export`.
pub(crate) struct Change<S> {
    function: &'static str,
    config: *mut S,
}

impl<S: Opaque> Change<S> {
    /// # Safety
    /// As for [`Call::sealed_mut`], as long as this lives.
    pub(crate) unsafe fn new(function: &'static str, config: *mut S) -> Self {
        Self { function, config }
    }

    /// Changes the configuration.
    pub(crate) fn with(
        self,
        change: impl FnOnce(Call, &mut S::Value) -> Result<(), ecan_result_t>,
    ) -> c_int {
        call(self.function, |call| {
            // SAFETY: the promise of `new`.
            change(call, unsafe { call.sealed_mut("config", self.config)? })
        })
    }
}
